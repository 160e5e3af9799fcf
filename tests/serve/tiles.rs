//! Tiles: web map tiles as the library draws them, and tiles of a tree's own grid.

use spinney::raw::export::tiles::{TileId, TilePainter, TileRange, draw_tile, tile_source};
use spinney::style::Style;
use spinney::{Bounds, WarpOptions};

use super::{Server, island};

/// Returns red, green, blue and opacity of a PNG image's pixels.
fn pixels_of_png(bytes: &[u8]) -> Vec<u8> {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::ALPHA);
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    match frame.color_type {
        png::ColorType::Rgba => pixels,
        png::ColorType::GrayscaleAlpha => {
            pixels.chunks(2).flat_map(|pixel| [pixel[0], pixel[0], pixel[0], pixel[1]]).collect()
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn tiles_are_those_of_the_library() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let mut options = WarpOptions::default();
    options.level_cells = Some(WarpOptions::PREVIEW);
    for (name, style) in [("classes", None), ("heights", Some("hillshade")), ("heights", None)] {
        let tree = spinney::open(directory.path().join(format!("{name}.goblin"))).unwrap();
        let tiles = tile_source(&tree, 256, None, &options, &()).unwrap();
        let painted_style =
            style.map_or_else(|| Style::default_for(&tree), |style| Style::parse(style).unwrap());
        let painter = TilePainter::new(&painted_style, &tree, &()).unwrap();
        let query = style.map(|style| format!("?style={style}")).unwrap_or_default();
        let about = server.get(&format!("/tiles/{name}.json{query}")).json();
        assert_eq!((&about["tilejson"], &about["scheme"]), (&"3.0.0".into(), &"xyz".into()));
        let template = about["tiles"][0].as_str().unwrap();
        assert_eq!(template, format!("http://{}/tiles/{name}/{{z}}/{{x}}/{{y}}.png{query}", server.address));
        let [west, south, east, north] = [0, 1, 2, 3].map(|at| about["bounds"][at].as_f64().unwrap());
        assert!(
            west < east && south < north && (-18.0..-16.0).contains(&west) && (28.0..29.0).contains(&south)
        );
        let last = about["maxzoom"].as_u64().unwrap() as u8;
        let mut connection = server.connect();
        let (mut there, mut empty) = (0, 0);
        // The second time they come from the cache.
        for zoom in [0, 5, last - 1, last, last] {
            let range = TileRange::of_degrees(zoom, [west, south, east, north]);
            for row in range.min[1]..range.max[1] {
                for column in range.min[0]..range.max[0] {
                    let response =
                        connection.get(&format!("/tiles/{name}/{zoom}/{column}/{row}.png{query}")).unwrap();
                    match draw_tile(&*tiles, &painter, TileId { zoom, column, row }, 256).unwrap() {
                        Some(expected) => {
                            there += 1;
                            assert_eq!(response.header("content-type"), Some("image/png"));
                            let found = pixels_of_png(&response.good());
                            assert!(found == expected.as_flattened(), "{name} {zoom}/{column}/{row}");
                        }
                        None => {
                            empty += 1;
                            assert_eq!(response.status, 204);
                        }
                    }
                }
            }
        }
        assert!(there >= 4, "{there} tiles, {empty} without anything");
        assert_eq!(server.get(&format!("/tiles/{name}/3/0/0.png")).status, 204);
    }
}

#[test]
fn tiles_of_the_own_grid_are_its_cells() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let about = server.get("/tiles/heights.json?grid=native&format=npy").json();
    assert_eq!(about["grid"]["cells"], serde_json::json!([256, 200]));
    assert!(about["tiles"][0].as_str().unwrap().ends_with(".npy?grid=native"), "{about}");
    assert!(about.get("bounds").is_none());
    let tree = spinney::open(directory.path().join("heights.goblin")).unwrap();
    assert_eq!(about["maxzoom"].as_u64(), Some(u64::from(tree.depth() - 8)));
    let cells = server.get("/tiles/heights/0/0/0.npy?grid=native").good();
    let bounds = Bounds { min: [0; 3], max: [256, 256, 1] };
    let width = tree.header().form.width();
    let (mut bytes, mut valid) = (vec![0; 256 * 256 * width], vec![false; 256 * 256]);
    tree.window(tree.depth(), &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    let found = &cells[cells.len() - bytes.len()..];
    for ((found, expected), valid) in found.chunks(width).zip(bytes.chunks(width)).zip(valid) {
        assert!(!valid || found == expected);
    }
    let tile = |ending: &str| {
        let tile = server.get(&format!("/tiles/heights/0/0/0.{ending}?grid=native&style=terrain"));
        assert_eq!(tile.header("content-type"), Some(&*format!("image/{ending}")));
        tile.good()
    };
    let webp =
        image::load_from_memory_with_format(&tile("webp"), image::ImageFormat::WebP).unwrap().into_rgba8();
    assert!(webp.dimensions() == (256, 256) && *webp.as_raw() == pixels_of_png(&tile("png")));
    // At a deeper zoom, a tile has as many cells as pixels; for a stack, the query names a layer,
    // or several as colours.
    let about = server.get("/tiles/stack.json?grid=native&layer=0").json();
    assert!(about["tiles"][0].as_str().unwrap().contains("layer=0"), "{about}");
    server.get("/tiles/stack/0/0/0.png?grid=native&layer=0").good();
    server.get("/tiles/history/0/0/0.png?grid=native&commit=1").good();
}

#[test]
fn invalid_tiles_are_rejected() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    for (target, status, what) in [
        ("/tiles/classes/3/8/0.png", 404, "0 to 7"),
        ("/tiles/classes/29/0/0.png", 404, "zoom"),
        ("/tiles/classes/3/0/0.tif", 400, "format"),
        ("/tiles/classes/3/0/0", 400, "format"),
        ("/tiles/classes/a/0/0.png", 400, "tile"),
        ("/tiles/classes/0/0/0.png?grid=other", 400, "grid"),
        ("/tiles/classes/0/0/0.png?style=nothing", 400, "style"),
        ("/tiles/classes/0/0/0.npy?style=terrain", 400, "style"),
        ("/tiles/classes/0/0/0.png?size=3", 400, "size"),
        ("/tiles/nothing/0/0/0.png", 404, "nothing"),
        ("/tiles/nothing.json", 404, "nothing"),
        ("/tiles/classes", 404, "json"),
        ("/tiles/classes.json?style={", 400, ""),
        ("/tiles/ball/0/0/0.png", 422, "octree"),
        ("/tiles/chapel.json", 422, ""),
        ("/tiles/stack.json", 400, "layer"),
        ("/tiles/classes/0/0/0.png?layer=other", 400, "layer"),
    ] {
        let message = server.get(target).complaint(status);
        assert!(message.contains(what), "{target}: {message}");
    }
    // An invalid host is not echoed.
    let head = b"GET /tiles/classes.json HTTP/1.1\r\nHost: \"><script>\r\n\r\n";
    let mut connection = server.connect();
    connection.send(head).unwrap();
    let response = connection.receive(false).unwrap();
    assert!(response.status == 400 || !response.text().contains("script"));
}

#[test]
fn cached_responses_are_not_sent_again() {
    let directory = island();
    let server = Server::start(directory.path(), &[]);
    let target = "/tiles/heights/0/0/0.png?grid=native";
    let tag = server.get(target).header("etag").unwrap().to_owned();
    let again = || server.get_with(target, &[("If-None-Match", &tag)]);
    assert_eq!(again().status, 304);
    // A replaced file has another tag.
    std::fs::copy(directory.path().join("classes.goblin"), directory.path().join("other")).unwrap();
    std::fs::rename(directory.path().join("other"), directory.path().join("heights.goblin")).unwrap();
    let other = again();
    assert_ne!(other.header("etag"), Some(&*tag));
    other.good();
}
