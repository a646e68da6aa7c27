"""`homeward` with shorter waits: topics settle and the state is saved in a fraction of a second."""

import sys

from homeward.__main__ import run
from homeward.watch.online import listener, session

if __name__ == "__main__":
    listener._SETTLES_S = 0.5
    session._SAVED_S = 0.2
    sys.argv[0] = "homeward"
    sys.exit(run())
