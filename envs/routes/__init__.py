"""Routes: their contents and a seeded generator (`route`), and those from files (`files`,
`tracks`)."""

from homeward.envs.routes.files import load_route, route_names
from homeward.envs.routes.route import Route, RouteError

__all__ = ["Route", "RouteError", "load_route", "route_names"]
