"""Pages: in a directory, as one file, and in a notebook."""

import json
import pathlib

import pytest

import spinney

FIXTURES = pathlib.Path(__file__).parents[2] / "fixtures"


@pytest.fixture
def island(tmp_path):
    path = tmp_path / "island.goblin"
    spinney.build(FIXTURES / "island_classes.tif", path)
    with spinney.open(path) as ds:
        yield ds


def test_pages_are_written(island, tmp_path):
    assert island.export(tmp_path / "site/index.html", style="viridis", name="An island") > 10
    page = (tmp_path / "site/index.html").read_text()
    configuration = json.loads(page.split('id="configuration">')[1].split("</script>")[0])
    assert configuration["sources"][0]["url"] == "island.goblin"
    assert json.loads(configuration["sources"][0]["style"])["ramp"] == "viridis"
    assert "<title>An island</title>" in page
    assert (tmp_path / "site/island.goblin").read_bytes() == pathlib.Path(island.path).read_bytes()
    assert island.export(tmp_path / "one.html", self_contained=True) == 1
    assert (tmp_path / "one.html").stat().st_size > 1_000_000
    with pytest.raises(TypeError, match="zoom"):
        island.export(tmp_path / "site/index.html", zoom=3)


def test_the_kernel_reads_for_the_page_and_gets_its_polygon(island):
    pytest.importorskip("anywidget")
    page = island.show(height=300)
    sent = []
    page.send = lambda content, buffers=None: sent.append((content, buffers))
    data = pathlib.Path(island.path).read_bytes()
    page._send_range(page, {"range": 1, "start": 8, "end": 40}, [])
    page._send_range(page, {"range": 2, "start": 8, "end": len(data) + 1}, [])
    assert sent[0] == ({"range": 1}, [data[8:40]])
    assert sent[1][0]["range"] == 2 and "failure" in sent[1][0]
    assert page.polygon is None and page.statistics is None
    polygon = {"type": "Polygon", "coordinates": [[[-17.0, 28.86], [-16.99, 28.86], [-16.99, 28.87], [-17.0, 28.86]]]}
    page._drawn = json.dumps({"geometry": polygon, "crs": "lonlat", "zone": {"cells": 7}})
    assert page.polygon == polygon and page.crs == "lonlat" and page.statistics == {"cells": 7}
    assert island.zonal([page.polygon], crs=page.crs, edge="area")[0].cells > 0


def test_views_are_not_shown(island):
    turned = spinney.open(island.path, view="rotate=90")
    with pytest.raises(ValueError, match="transform"):
        turned.show()
