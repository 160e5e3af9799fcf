//! CityJSON and CityJSONSeq.

use super::mesh_files::*;
use spinney::Crs;
use spinney::import::mesh::{SolidOptions, plan_models};
use spinney::raw::import::mesh::open;

/// Returns the sides as a list of surfaces.
fn surfaces() -> String {
    let sides: Vec<String> = CUBE.iter().map(|side| format!("[{side:?}]")).collect();
    format!("[{}]", sides.join(","))
}

fn vertices() -> String {
    format!("{:?}", cube_points().iter().map(|point| point.map(|x| x as i64 * 1000)).collect::<Vec<_>>())
}

const TRANSFORM: &str = r#""transform":{"scale":[0.001,0.001,0.001],"translate":[0,0,0]}"#;

fn file(objects: &str) -> String {
    format!(
        "{{\"type\":\"CityJSON\",\"version\":\"2.0\",{TRANSFORM},\n\"CityObjects\":{{{objects}}},\n\
         \"metadata\":{{\"referenceSystem\":\"https://www.opengis.net/def/crs/EPSG/0/7415\"}},\n\"vertices\":{}}}",
        vertices()
    )
}

fn object(name: &str, kind: &str, lod: &str, boundaries: &str) -> String {
    format!(
        "\"{name}\":{{\"type\":\"Building\",\"geometry\":[\
         {{\"boundaries\":[[0]],\"type\":\"MultiPoint\",\"lod\":\"9\"}},\
         {{\"boundaries\":[[[[1,2,3]]]],\"type\":\"Solid\",\"lod\":\"1.2\"}},\
         {{\"boundaries\":{boundaries},\"type\":\"{kind}\",\"lod\":{lod},\"semantics\":{{\"values\":[[null]]}}}},\
         {{\"boundaries\":[[[3,2,1]]],\"type\":\"MultiSurface\",\"lod\":\"1.3\"}}]}}"
    )
}

pub(crate) fn text_cube() -> String {
    file(&object("b", "Solid", "\"2.2\"", &format!("[{}]", surfaces())))
}

#[test]
fn kinds_of_geometry() {
    let files = Files::new();
    let all = surfaces();
    for (kind, lod, boundaries) in [
        ("Solid", "\"2.2\"", format!("[{all}]")),
        ("Solid", "2", format!("[{all}]")),
        ("MultiSurface", "\"2\"", all.clone()),
        ("CompositeSurface", "2.0", all.clone()),
        ("MultiSolid", "\"2\"", format!("[[{all}]]")),
        ("CompositeSolid", "\"2\"", format!("[[{all}]]")),
    ] {
        let text = file(&object("b", kind, lod, &boundaries));
        assert_eq!(files.faces("a.json", text).unwrap(), cube(), "{kind} {lod}");
    }
    let shells = file(&object("b", "Solid", "\"2\"", &format!("[{all},{all}]")));
    assert_eq!(files.faces("a.json", shells).unwrap(), [cube(), cube()].concat());
    let mut model = files.open("a.json", text_cube()).unwrap();
    // Five sides have no semantics.
    model.faces(&mut |_| Ok(())).unwrap();
    assert_eq!(model.lost_values(), 5);
    let info = model.info();
    assert_eq!(info.bounds, [[0.0; 3], [2.0; 3]]);
    assert_eq!(
        (info.crs.clone(), info.unit.as_deref(), info.faces),
        (Some(Crs::epsg(7415)), Some("m"), None)
    );
    assert_eq!(info.format, "CityJSON 2.0");
}

#[test]
fn objects_are_parts_and_solids_come_before_surfaces() {
    let files = Files::new();
    let both = format!(
        "\"c\":{{\"geometry\":[{{\"type\":\"MultiSurface\",\"lod\":\"2\",\"boundaries\":{0}}},\
         {{\"type\":\"Solid\",\"lod\":\"2\",\"boundaries\":[{0}]}},\
         {{\"type\":\"MultiSurface\",\"lod\":\"2\",\"boundaries\":{0}}}]}},\"none\":{{\"type\":\"Building\"}}",
        surfaces()
    );
    let text = file(&format!("{both},{}", object("b", "MultiSurface", "3", &surfaces())));
    let mut model = files.open("a.json", text).unwrap();
    assert_eq!(model.info().parts, ["c", "none", "b"]);
    let parts: Vec<u32> = faces(&mut *model).unwrap().iter().map(|face| face.part).collect();
    assert_eq!(parts, [[0; 6], [2; 6]].concat());
}

#[test]
fn holes() {
    let rings = "[[[0,1,3,2],[4,5,6],[7,7,7],[4,5,7,4]],[],[[0,1]],[[]]]";
    let mut model = Files::new().open("a.json", file(&object("b", "MultiSurface", "3", rings))).unwrap();
    let faces = faces(&mut *model).unwrap();
    assert_eq!(faces.len(), 1);
    assert_eq!(faces[0].ring_ends, [4, 7, 10]);
    assert_eq!(faces[0].points[7], cube_points()[4]);
    assert_eq!(model.degenerate(), 3);
}

#[test]
fn sequences() {
    let feature = |name: &str, shift: i64| {
        let objects = object(name, "Solid", "\"2.2\"", &format!("[{}]", surfaces()));
        let points: Vec<[i64; 3]> =
            cube_points().iter().map(|p| p.map(|x| x as i64 * 1000 + shift)).collect();
        format!(
            "{{\"type\":\"CityJSONFeature\",\"id\":\"x\",\"CityObjects\":{{{objects}}},\"vertices\":{points:?}}}\n"
        )
    };
    let head = format!(
        "{{\"type\":\"CityJSON\",\"version\":\"2.0\",{TRANSFORM},\"CityObjects\":{{}},\"vertices\":[]}}\n"
    );
    let text = head + &feature("a", 0) + &feature("b", 5000);
    let files = Files::new();
    let mut model = files.open("a.city.jsonl", &text).unwrap();
    assert_eq!(model.info().parts, ["a", "b"]);
    assert_eq!(model.info().bounds, [[0.0; 3], [7.0; 3]]);
    let faces = faces(&mut *model).unwrap();
    assert_eq!(faces[..6], cube());
    assert_eq!(faces[6].points[0], [5.0; 3]);
    assert_eq!(faces[6].part, 1);
    let broken = text.replacen("CityJSONFeature", "Feature", 1);
    assert!(files.error("a.jsonl", broken).contains("JSON value 2"));
    let broken = text.replace("[[[0,1]]", "[[[0,1]").replacen("\"id\":\"x\"", "\"id\":", 2);
    assert!(files.error("a.jsonl", broken).contains("line 2"));
}

/// A cube as a template, at two positions: scaled by two and rotated, and unchanged at another
/// level of detail.
fn templates() -> String {
    let points: Vec<[f64; 3]> = cube_points().to_vec();
    let templates = format!(
        "\"geometry-templates\":{{\"templates\":[\
         {{\"type\":\"Solid\",\"lod\":\"2\",\"boundaries\":[{all}]}},\
         {{\"type\":\"MultiSurface\",\"lod\":\"3\",\"boundaries\":{all}}}],\
         \"vertices-templates\":{points:?}}},",
        all = surfaces()
    );
    let instance = |template: u8, matrix: &str| {
        format!(
            "{{\"type\":\"GeometryInstance\",\"template\":{template},\"boundaries\":[7],\
             \"transformationMatrix\":[{matrix},0,0,0,1]}}"
        )
    };
    let large = instance(0, "2,0,0,10,0,0,-2,0,0,2,0,0.5");
    let both = [large.clone(), instance(1, "1,0,0,-5,0,1,0,0,0,0,1,0")].join(",");
    let tree = |name: &str, geometry: &str| {
        format!("\"{name}\":{{\"type\":\"SolitaryVegetationObject\",\"geometry\":[{geometry}]}}")
    };
    let objects = [tree("one", &large), tree("fine", &both)].join(",");
    file(&objects).replacen("\"CityObjects\"", &format!("{templates}\"CityObjects\""), 1)
}

#[test]
fn templates_are_instantiated_at_their_positions() {
    let files = Files::new();
    let corner = cube_points()[7];
    let moved = |map: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let mut faces = cube();
        for point in faces.iter_mut().flat_map(|face| &mut face.points) {
            let [x, y, z] = map(*point);
            *point = [x + corner[0], y + corner[1], z + corner[2]];
        }
        faces
    };
    let mut expected = moved(&|[x, y, z]| [2.0 * x + 10.0, -2.0 * z, 2.0 * y + 0.5]);
    let mut fine = moved(&|[x, y, z]| [x - 5.0, y, z]);
    fine.iter_mut().for_each(|face| face.part = 1);
    expected.extend(fine);
    assert_eq!(files.faces("a.json", templates()).unwrap(), expected);
    for (from, to, message) in [
        ("\"template\":0", "\"template\":2", "an instance of template 2, expected one of the 2"),
        ("\"template\":0", "\"template\":-1", "line 2"),
        ("\"boundaries\":[7]", "\"boundaries\":[8]", "vertex 8 of 8"),
        ("\"boundaries\":[7]", "\"boundaries\":[7,7]", "2 vertices"),
        ("[2,0,0,10", "[1e308,0,0,1e308", "finite coordinates"),
        ("[2,0,0,10,", "[2,0,0,", "an array of length 16"),
        ("\"transformationMatrix\"", "\"transformation\"", "transformationMatrix"),
    ] {
        assert!(templates().contains(from), "{from}");
        let found = files.error("a.json", templates().replacen(from, to, 1));
        assert!(found.contains(message), "{from} -> {to}: {found}");
    }
    assert_eq!(read_truncated("a.json", templates().as_bytes()), 0);
}

#[test]
fn broken() {
    let files = Files::new();
    for (from, to, expected) in [
        ("[[0, 4, 6, 2]]", "[[0, 4, 6, 8]]", "object \"b\""),
        ("[[0, 4, 6, 2]]", "[[0, 4, 6, -1]]", "line 2"),
        ("[[0, 4, 6, 2]]", "[[0, 4, 6, 1.5]]", "line 2"),
        ("[[0, 4, 6, 2]]", "[[0, 4, [6], 2]]", "line 2"),
        ("[[0, 4, 6, 2]]", "[0, 4, 6, 2]", "line 2"),
        ("[[0, 4, 6, 2]]", "[[0, 4, 6, 99999999999999999999]]", "line 2"),
        ("[0, 0, 0]", "[0, 0]", "line 4"),
        ("[0, 0, 0]", "[0, 0, 1e999]", "line 4"),
        ("[0, 0, 0]", "[0, 0, null]", "line 4"),
        ("[0.001,", "[1e308,", "vertex 1"),
        ("\"2.0\"", "\"3.0\"", "is not supported"),
        ("\"type\":\"CityJSON\"", "\"type\":\"FeatureCollection\"", "a GeoJSON document"),
        ("\"type\":\"CityJSON\"", "\"type\":\"Topology\"", "\"CityJSON\""),
        ("\"2.2\"", "\"high\"", "level of detail"),
        ("\"MultiPoint\"", "\"GeometryInstance\"", "transformationMatrix"),
    ] {
        assert!(text_cube().contains(from), "{from}");
        let found = files.error("a.json", text_cube().replacen(from, to, 1));
        assert!(found.contains(expected), "{from} -> {to}: {found}");
    }
    assert_eq!(read_truncated("a.json", text_cube().as_bytes()), 0);
}

#[test]
fn real_cities() {
    let Some(directory) = meshes() else { return };
    // Objects, surfaces of each one's highest level of detail, and surfaces with fewer than three
    // distinct vertices, counted by a short independent program.
    for (name, objects, surfaces, degenerate) in [
        ("DH_01_subs.city.json", 12, 70, 0),
        ("delft.json", 570, 36_271, 0),
        ("rotterdam_subset.json", 16, 248, 12),
    ] {
        let mut model = open(&directory.join("cityjson").join(name), ENOUGH).unwrap();
        let faces = faces(&mut *model).unwrap();
        assert_eq!(model.info().parts.len(), objects, "{name}");
        assert_eq!(faces.len() as u64 + model.degenerate(), surfaces, "{name}");
        assert_eq!(model.degenerate(), degenerate, "{name}");
    }
}

#[test]
fn models_in_different_systems_are_no_solid() {
    let files = Files::new();
    let plan = |systems: [&str; 2], crs: Option<Crs>| {
        let model = |(name, system): (&str, &str)| {
            let text = text_cube().replace("https://www.opengis.net/def/crs/EPSG/0/7415", system);
            files.open(name, text).unwrap()
        };
        let mut options = SolidOptions::new();
        options.crs = crs;
        plan_models([("a.json", systems[0]), ("b.json", systems[1])].map(model).into(), &options)
            .err()
            .map(|error| error.to_string())
    };
    assert_eq!(plan(["EPSG:7415", "urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709"], None), None);
    let error = plan(["EPSG:7415", "EPSG:28992"], None).unwrap();
    assert!(error.contains("EPSG:7415") && error.contains("--crs"), "{error}");
    assert_eq!(plan(["EPSG:7415", "EPSG:28992"], Some(Crs::epsg(28992))), None);
}
