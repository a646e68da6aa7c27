"""A file that nothing reads is refused by every reader with what to do."""

from pathlib import Path

import pytest

from homeward.envs.routes import RouteError, load_route
from homeward.logs import RecordingError, read_recording
from homeward.logs.propose import propose


@pytest.mark.parametrize(
    ("name", "remedy", "as_route"),
    [
        ("a.mcap.zstd", "zstd -d FILE", "zstd -d FILE"),
        ("a.bag.gz", "gunzip FILE", "gunzip FILE"),
        ("a.tlog", "mavlogdump", "is a recording"),
        ("a.TCX", "gpsbabel", "gpsbabel"),
        ("a.mat", "CSV or Parquet", "not a readable CSV table"),
    ],
)
def test_every_reader_names_the_remedy(
    tmp_path: Path, name: str, remedy: str, as_route: str
) -> None:
    path = tmp_path / name
    path.write_text("xxxxxxxx")
    for read in (read_recording, propose):
        with pytest.raises(RecordingError, match=remedy):
            read(path)
    with pytest.raises(RouteError, match=as_route):
        load_route(path, 50.0)
