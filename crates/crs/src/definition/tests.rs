use proptest::prelude::*;

use super::*;

/// Equal-area maps of Africa and of Europe, and a compound system, in both versions of WKT.
const LAEA: &str = r#"PROJCS["mine",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],
    PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]],
    PROJECTION["Lambert_Azimuthal_Equal_Area"],PARAMETER["latitude_of_center",12],
    PARAMETER["longitude_of_center",3],PARAMETER["false_easting",0],UNIT["metre",1],AXIS["Easting",EAST]]"#;
const LAEA2: &str = r#"PROJCRS["mine",BASEGEOGCRS["WGS 84",DATUM["World Geodetic System 1984",
    ELLIPSOID["WGS 84",6378137,298.257223563,LENGTHUNIT["metre",1]]],ID["EPSG",4326]],
    CONVERSION["unnamed",METHOD["Lambert Azimuthal Equal Area",ID["EPSG",9820]],
    PARAMETER["Latitude of natural origin",12,ANGLEUNIT["degree",0.0174532925199433]]],
    CS[Cartesian,2],AXIS["(E)",east,ORDER[1],LENGTHUNIT["US survey foot",0.304800609601219]],
    USAGE[SCOPE["unknown"],AREA["Africa"],BBOX[-30,-20,40,50]]]"#;
const PAIR: &str = r#"COMPD_CS["RD New + NAP",PROJCS["Amersfoort / RD New",GEOGCS["Amersfoort",DATUM["Amersfoort",
    SPHEROID["Bessel 1841",6377397.155,299.1528128]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],
    PROJECTION["Oblique_Stereographic"],UNIT["metre",1],AUTHORITY["EPSG","28992"]],
    VERT_CS["NAP height",VERT_DATUM["NAP",2005],UNIT["metre",1],AUTHORITY["EPSG","5709"]]]"#;
const JSON: &str = r#"{"$schema":"https://proj.org/schemas/v0.7/projjson.schema.json","type":"GeographicCRS",
    "name":"on a ball","datum":{"type":"GeodeticReferenceFrame","name":"ball","ellipsoid":{"name":"ball","radius":6370997}},
    "coordinate_system":{"subtype":"ellipsoidal","axis":[{"name":"Longitude","abbreviation":"lon","direction":"east",
    "unit":"degree"}]},"scope":"all"}"#;

fn parsed(text: &str) -> Crs {
    Crs::parse(text).unwrap()
}

fn refused(text: &str) -> String {
    Crs::parse(text).unwrap_err().to_string()
}

/// Keys from entries (without doubles if the tag is 0), as in a file.
fn keys(entries: &[[u16; 4]], doubles: &[f64], strings: &str) -> Crs {
    let directory = [&[[1, 1, 0, entries.len() as u16]], entries].concat();
    Crs::GeoKeys(GeoKeys::new(directory.as_flattened(), doubles, strings.as_bytes()).unwrap())
}

/// Lambert's equal-area projection at a latitude, with a writer-specific citation.
fn equal_area(latitude: f64, citation: &str) -> Crs {
    let entries = [
        [1024, 0, 1, 1],
        [1025, 0, 1, 1],
        [1026, 34737, citation.len() as u16, 0],
        [2048, 0, 1, 4326],
        [3072, 0, 1, 32767],
        [3074, 0, 1, 32767],
        [3075, 0, 1, 10],
        [3076, 0, 1, 9001],
        [3082, 34736, 1, 0],
        [3089, 34736, 1, 1],
    ];
    keys(&entries, &[0.0, latitude], citation)
}

#[test]
fn the_form_of_a_definition_is_detected() {
    let numbers = |horizontal, vertical| Crs::Epsg(Epsg { horizontal, vertical });
    let forms = [
        ("EPSG:4326", numbers(4326, None)),
        (" epsg:4326+5773\n", numbers(4326, Some(5773))),
        ("EPSG::4979", numbers(4979, None)),
        ("urn:ogc:def:crs:EPSG::28992", numbers(28992, None)),
        ("urn:ogc:def:crs:EPSG:6.9:28992", numbers(28992, None)),
        ("urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709", numbers(28992, Some(5709))),
        ("https://www.opengis.net/def/crs/EPSG/0/7415", numbers(7415, None)),
        (LAEA, Crs::Wkt(LAEA.into())),
        (JSON, Crs::ProjJson(JSON.into())),
        (" +proj=utm  +zone=32 ", Crs::Proj("+proj=utm  +zone=32".into())),
    ];
    for (text, crs) in forms {
        assert_eq!(parsed(text), crs, "{text}");
    }
    for text in [
        "",
        "4326",
        "EPSG:",
        "EPSG:4326+",
        "EPSG:x",
        "ESRI:102008",
        "urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709x",
        "https://www.opengis.net/def/crs/OGC/0/CRS84",
        "proj=utm +zone=32",
    ] {
        assert!(refused(text).contains("WKT"), "{text}");
    }
    for text in [
        "PROJCS[",
        "PROJCS[\"a\"",
        "PROJCS[\"a",
        "PROJCS[\"a\",]",
        "PROJCS(\"a\"]",
        "UNIT[\"m\",1]",
        "GEOGCS[\"a\"] b",
    ] {
        assert!(refused(text).contains("expected WKT of a coordinate system"), "{text}");
    }
    for text in [
        "+",
        "+proj",
        "+zone=32",
        "+proj=",
        "+proj=utm zone=32",
        "+proj=utm +zone=1 +zone=1",
        "+proj=utm +zone=\"1",
        "+proj=a=b",
    ] {
        assert!(refused(text).contains("a PROJ string"), "{text}");
    }
    for text in ["{", "{}", "{\"type\":\"Ellipsoid\"}", "{\"type\":1}"] {
        assert!(refused(text).contains("PROJJSON"), "{text}");
    }
}

#[test]
fn malicious_strings_are_errors() {
    let nested = |open: &str, close: &str| {
        let depth = 100_000;
        format!("{}{}{}", open.repeat(depth), 1, close.repeat(depth))
    };
    assert!(refused(&nested("GEOGCS[", "]")).contains("levels"));
    assert!(refused(&nested("{\"type\":", "}")).contains("recursion"));
    assert!(refused(&format!("GEOGCS[\"{}\"]", "a".repeat(2 << 20))).contains("1 MiB"));
    assert!(refused(&format!("{{\"type\":\"{}CRS\"}}", "a".repeat(2 << 20))).contains("1 MiB"));
    // A tree's file may contain anything.
    for text in ["", "{", "GEOGCS[", "\u{1f600}["] {
        for crs in [Crs::Wkt(text.into()), Crs::ProjJson(text.into())] {
            assert_eq!((crs.numbers(), crs.name(), crs.unit()), (None, None, None));
            assert!(crs.is_same(&crs.clone()) && !crs.is_same(&Crs::Wkt("other".into())));
            assert!(crs.to_string().contains("without an EPSG number"));
        }
    }
    // Keys that all share the same long string.
    let entries: Vec<_> = (0..u16::MAX).map(|number| [number, 34737, u16::MAX, 0]).collect();
    let crs = keys(&entries, &[], &"a".repeat(1 << 20));
    assert!(crs.definition().len() < 1 << 20 && crs.is_same(&crs.clone()));
}

#[test]
fn names_numbers_and_units() {
    let summary = |crs: &Crs| (crs.name().unwrap_or_default(), crs.numbers(), crs.unit());
    let pair = Some(Epsg { horizontal: 28992, vertical: Some(5709) });
    assert_eq!(summary(&parsed(LAEA)), ("mine".into(), None, Some("m")));
    assert_eq!(summary(&parsed(LAEA2)), ("mine".into(), None, Some("us-ft")));
    assert_eq!(summary(&parsed(PAIR)), ("RD New + NAP".into(), pair, Some("m")));
    assert_eq!(summary(&parsed(JSON)), ("on a ball".into(), None, Some("degrees")));
    assert_eq!(summary(&equal_area(12.0, "Africa|")), ("Africa".into(), None, Some("m")));
    assert_eq!(parsed(PAIR).to_string(), "EPSG:28992+5709 (RD New + NAP)");
    assert_eq!(parsed(LAEA).to_string(), "mine (WKT without an EPSG number)");
    let numbered = LAEA.replace("AXIS[\"Easting\",EAST]", "AUTHORITY[\"EPSG\",\"42106\"]");
    assert_eq!(parsed(&numbered).numbers(), Some(Epsg::new(42106)));
    let numbered = JSON.replacen('{', "{\"id\":{\"authority\":\"EPSG\",\"code\":4035},", 1);
    assert_eq!(parsed(&numbered).numbers(), Some(Epsg::new(4035)));
    let other = JSON.replacen('{', "{\"id\":{\"authority\":\"ESRI\",\"code\":4035},", 1);
    assert_eq!(parsed(&other).numbers(), None);
    let pair =
        format!("{{\"type\":\"CompoundCRS\",\"name\":\"both\",\"components\":[{numbered},{numbered}]}}");
    assert_eq!(parsed(&pair).numbers(), Some(Epsg { horizontal: 4035, vertical: Some(4035) }));
    assert_eq!(parsed(&pair).unit(), Some("degrees"));
}

#[test]
fn same_systems() {
    let spread = LAEA.replace(',', " ,\n ").replace("PROJCS", "ProjCS").replace('[', " (").replace(']', ") ");
    assert!(parsed(LAEA).is_same(&parsed(&spread)));
    let same = [(LAEA, ",12]", ",12.0]"), (LAEA2, "\"Africa\"", "\"Asia\""), (JSON, "\"all\"", "\"none\"")];
    for (text, from, to) in same.into_iter().chain([(JSON, "v0.7", "v0.5"), (JSON, "6370997", "6370997.0")]) {
        assert!(text.contains(from) && parsed(text).is_same(&parsed(&text.replace(from, to))), "{from}");
    }
    for (text, from, to) in
        [(LAEA, ",12]", ",13]"), (LAEA, "WGS 84", "WGS  84"), (LAEA2, ",12,", ",-12,"), (JSON, "997", "998")]
    {
        assert!(text.contains(from) && !parsed(text).is_same(&parsed(&text.replace(from, to))), "{from}");
    }
    let turned = r#"{"type":"GeographicCRS","name":"n","a":1}"#;
    assert!(parsed(turned).is_same(&parsed(r#"{"a":1,"name":"n","type":"GeographicCRS"}"#)));
    // The same system under its own code or those of its components.
    assert!(Crs::epsg(7415).is_same(&parsed(PAIR)));
    assert!(!Crs::epsg(28992).is_same(&parsed(PAIR)));
    assert!(!parsed(LAEA).is_same(&parsed(LAEA2)) && !parsed(LAEA).is_same(&Crs::epsg(4326)));
    // Citations are remarks, values are not.
    assert!(equal_area(12.0, "Africa|").is_same(&equal_area(12.0, "unnamed|")));
    assert!(!equal_area(12.0, "unknown|").is_same(&equal_area(52.0, "unknown|")));
}

#[test]
fn strings_in_keys_define_systems() {
    let cited = |entries: &[[u16; 4]], text: &str| {
        let citation = [3073, 34737, text.len() as u16, 0];
        keys(&[entries, &[citation]].concat(), &[], text)
    };
    // A projection that only a citation defines, and a datum.
    for entries in [&[[1024, 0, 1, 32767]][..], &[[1024, 0, 1, 1], [3072, 0, 1, 32767]]] {
        let [a, b] = ["ESRI PE String = PROJCS[\"a\"]|", "ESRI PE String = PROJCS[\"b\"]|"];
        assert!(
            cited(entries, a).is_same(&cited(entries, a)) && !cited(entries, a).is_same(&cited(entries, b))
        );
    }
    let datum = |name: &str| {
        let citation = [2049, 34737, name.len() as u16, 0];
        keys(
            &[[1024, 0, 1, 2], [2048, 0, 1, 32767], citation, [2050, 0, 1, 32767], [2056, 0, 1, 7004]],
            &[],
            name,
        )
    };
    assert!(!datum("Datum = one|").is_same(&datum("Datum = another|")));
}

#[test]
fn numbers_of_keys() {
    let numbers = |entries: &[[u16; 4]], text: &str| {
        let text_key = [1026, 34737, text.len() as u16, 0];
        keys(&[entries, &[text_key]].concat(), &[], text).numbers().map(|epsg| epsg.to_string())
    };
    let projected = [1024, 0, 1, 1];
    let geographic = [1024, 0, 1, 2];
    let cases: [(&[[u16; 4]], Option<&str>); 14] = [
        (&[projected, [3072, 0, 1, 32628], [3076, 0, 1, 9001]], Some("EPSG:32628")),
        (&[[3072, 0, 1, 32628]], Some("EPSG:32628")),
        (&[geographic, [2048, 0, 1, 4326], [2054, 0, 1, 9102]], Some("EPSG:4326")),
        (&[projected, [2048, 0, 1, 4326], [3072, 0, 1, 32767], [3074, 0, 1, 3856]], Some("EPSG:3857")),
        // Feet although the system is in metres, and vice versa.
        (&[projected, [3072, 0, 1, 32628], [3076, 0, 1, 9002]], None),
        (&[projected, [3072, 0, 1, 2263], [3076, 0, 1, 9003]], Some("EPSG:2263")),
        (&[projected, [3072, 0, 1, 2263], [3076, 0, 1, 9001]], None),
        // User-defined systems based on a system with a code.
        (&[projected, [2048, 0, 1, 4326], [3072, 0, 1, 32767]], None),
        (&[[1024, 0, 1, 32767], [2048, 0, 1, 4326]], None),
        // Heights.
        (&[geographic, [2048, 0, 1, 4326], [4096, 0, 1, 5773]], Some("EPSG:4326+5773")),
        (&[geographic, [2048, 0, 1, 4326], [4096, 0, 1, 4979]], Some("EPSG:4979")),
        (&[geographic, [2048, 0, 1, 4326], [4096, 0, 1, 32767]], None),
        (&[projected, [3072, 0, 1, 32631], [4096, 0, 1, 4979]], None),
        (&[projected, [3072, 0, 1, 32631], [4096, 0, 1, 5773], [4099, 0, 1, 9002]], None),
    ];
    for (entries, expected) in cases {
        assert_eq!(numbers(entries, "some words|").as_deref(), expected, "{entries:?}");
    }
    let imagine = "IMAGINE GeoTIFF Support\nUnits = us_survey_feet|";
    assert_eq!(numbers(&[projected, [3072, 0, 1, 2853]], imagine), None);
    for epsg in [4326, 32628, 2056, 4979].map(Epsg::new).into_iter().chain(Epsg::parse_numbers("4326+5773")) {
        let keys = GeoKeys::of_epsg(epsg).unwrap();
        assert_eq!(Crs::GeoKeys(keys).numbers(), Some(epsg));
    }
    assert_eq!(
        GeoKeys::of_epsg(Epsg::new(7415)),
        GeoKeys::of_epsg(Epsg::parse_numbers("28992+5709").unwrap())
    );
    assert_eq!(GeoKeys::of_epsg(Epsg::new(70000)), None);
}

#[test]
fn directories_are_kept_but_for_the_raster_type() {
    let directory = [[1, 1, 1, 3], [1024, 0, 1, 1], [1025, 0, 1, 2], [3072, 0, 1, 2056], [9, 9, 9, 9]];
    let keys = GeoKeys::new(directory.as_flattened(), &[], &[]).unwrap();
    let expected = [[1, 1, 1, 3], [1024, 0, 1, 1], [1025, 0, 1, 1], [3072, 0, 1, 2056]];
    assert_eq!(keys.directory(1), expected.as_flattened());
    // Counts beyond the end, and directories that define no system.
    assert!(GeoKeys::new(&[1, 1, 0, 60000, 3072, 0, 1, 2056, 7], &[], &[]).is_some());
    for nothing in [&[][..], &[1, 1], &[1, 1, 0, 0], &[1, 1, 0, 2, 1024, 0, 1, 1, 1025, 0, 1, 1]] {
        assert_eq!(GeoKeys::new(nothing, &[], &[]), None, "{nothing:?}");
    }
}

#[test]
fn different_systems_are_refused_with_a_way_out() {
    let check = |a: Option<&Crs>, b: Option<&Crs>| {
        Crs::check_same(("a.tif", a), ("b.tif", b)).map_err(|error| error.to_string())
    };
    let [a, b] = [12.0, 52.0].map(|latitude| equal_area(latitude, "unknown|"));
    assert_eq!(check(None, None), Ok(()));
    assert_eq!(check(Some(&a), Some(&a)), Ok(()));
    for (a, b) in
        [(Some(&a), Some(&b)), (Some(&a), None), (None, Some(&b)), (Some(&a), Some(&Crs::epsg(4326)))]
    {
        let error = check(a, b).unwrap_err();
        assert!(["a.tif", "b.tif", "--crs"].iter().all(|word| error.contains(word)), "{error}");
    }
}

proptest! {
    #[test]
    fn nothing_panics(
        text in "(GEOGCS|PROJCS|COMPD_CS|\\{\"type\":\"GeographicCRS\")?[\\[\\]\\(\\)\\{\\}\",:A-Z0-9.e+-]{0,40}",
        directory in prop::collection::vec(prop_oneof![any::<u16>(), 0u16..4, 34735u16..34738, 1024u16..1027], 0..60),
        doubles in prop::collection::vec(any::<f64>(), 0..4),
    ) {
        let strings = [Crs::Wkt(text.clone()), Crs::ProjJson(text.clone())].into_iter().chain(Crs::parse(&text).ok());
        let keys = GeoKeys::new(&directory, &doubles, text.as_bytes()).map(Crs::GeoKeys);
        for crs in strings.chain(keys) {
            let _ = (crs.numbers(), crs.name(), crs.unit(), crs.definition(), crs.to_string());
            prop_assert!(crs.is_same(&crs.clone()));
        }
    }
}
