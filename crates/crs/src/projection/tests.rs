use super::*;

/// Systems, longitudes and latitudes, and coordinates computed by PROJ 9.5.1.
const KNOWN: [(u32, f64, f64, f64, f64); 28] = [
    (4258, 12.8966, 52.082, 12.8966, 52.082),
    (4269, 159.8367, 45.9387, 159.8367, 45.9387),
    (3857, -27.1731, 55.6041, -3_024_895.655_274_7, 7_480_003.491_676_5),
    (3857, -135.4313, -47.0826, -15_076_143.353_471_1, -5_955_566.931_946_3),
    (32632, 9.7646, 79.6076, 515_397.134_870_8, 8_837_889.558_462_9),
    (32632, 9.4626, 33.3212, 543_057.090_216_3, 3_686_991.611_229_5),
    (32733, 17.8575, -76.2734, 575_662.030_604_4, 1_532_474.146_249_2),
    (25833, 12.867, 40.5877, 319_491.775_775_1, 4_495_176.072_673_4),
    (3035, -21.0478, 59.5716, 2_627_699.281_235_1, 4_431_697.193_982_6),
    (3034, 8.4641, 28.3755, 3_844_287.234_638_8, 211_004.043_058_1),
    (2154, 3.9113, 45.6012, 771_037.731_074_3, 6_500_596.705_393),
    (5070, -98.5597, 31.8952, -241_005.806_486_2, 983_351.952_172_7),
    (3413, -92.1253, 76.6583, -1_063_775.487_565_9, -987_646.193_830_6),
    (3031, 82.6003, -80.6498, 1_009_612.726_898_9, 131_120.423_473_7),
    (2193, 171.4962, -37.313, 1_466_744.143_426_6, 5_869_344.436_240_6),
    (28355, 144.2356, -23.0521, 216_732.185_319_3, 7_448_035.551_915_7),
    (3395, 135.172, -28.5454, 15_047_278.209_508_4, -3_297_498.200_857_1),
    (6933, 122.3884, 76.4851, 11_808_801.461_858_8, 7_137_164.988_147_9),
    (3347, -93.4674, 70.2553, 6_141_123.144_160_1, 3_744_148.566_889_8),
    (26912, -109.0685, 46.3196, 648_695.815_946_3, 5_131_371.175_582_2),
    (2056, 7.7076, 47.1506, 2_620_399.556_386_4, 1_222_215.656_452_4),
    (2056, 6.0622, 46.7388, 2_494_808.568_663_2, 1_177_325.393_683_7),
    (31370, 3.0044, 49.9977, 52_185.499_806_5, 77_161.647_468_9),
    (31370, 4.0247, 51.2516, 125_978.217_837_9, 215_799.273_037_5),
    (3067, 29.3292, 68.5598, 594_995.414_967_9, 7_607_076.721_924_1),
    (3067, 22.563, 63.5121, 279_333.532_156_6, 7_050_300.658_212_2),
    (8857, -116.5616, -47.7117, -9_388_498.388_023_6, -5_751_938.461_522_3),
    (8857, -95.999, -2.6766, -9_191_931.921_974_6, -343_847.077_725_8),
];

#[test]
fn coordinates_equal_those_of_proj() {
    for (number, longitude, latitude, x, y) in KNOWN {
        let projection = Projection::new(&Crs::epsg(number), false).unwrap();
        let point = projection.forward([longitude, latitude]).unwrap();
        assert!(
            (point[0] - x).abs() < 1e-3 && (point[1] - y).abs() < 1e-3,
            "EPSG:{number}: {point:?}, not {x}, {y}"
        );
        let back = projection.inverse(point).unwrap();
        // (Datum shifts ignore heights in both directions.)
        assert!(
            (back[0] - longitude).abs() < 1e-6 && (back[1] - latitude).abs() < 1e-6,
            "EPSG:{number}: {back:?}"
        );
    }
}

#[test]
fn systems_that_cannot_be_computed_are_refused_by_name() {
    let refusal =
        |crs: Crs| Projection::new(&crs, false).err().map(|error| error.to_string()).unwrap_or_default();
    for (number, text) in [
        (4267, "NAD27"),
        (2000, "whose shift to WGS 84 is not known"),
        (27200, "nzmg"),
        (4978, "geocent"),
        (2815, "PROJ has a newer shift"),
        (3973, "PROJ has a newer shift"),
        (60_000, "whose definition is not built in"),
    ] {
        let refusal = refusal(Crs::epsg(number));
        assert!(refusal.contains(text) && refusal.contains(&number.to_string()), "{number}: {refusal}");
    }
    let local = Crs::parse("LOCAL_CS[\"site\",UNIT[\"m\",1]]").unwrap();
    assert!(refusal(local).contains("without an EPSG number"));
}

#[test]
fn ballpark_takes_datums_for_wgs_84_and_says_so() {
    for number in [4267, 2000, 26712, 2815] {
        let projection = Projection::new(&Crs::epsg(number), true).unwrap();
        assert!(projection.remark().unwrap().contains("hundred metres"), "{number}");
        let [x, y] = projection.forward([-63.0, 18.2]).unwrap();
        let [longitude, latitude] = projection.inverse([x, y]).unwrap();
        assert!((longitude + 63.0).abs() < 1e-6 && (latitude - 18.2).abs() < 1e-6, "{number}");
    }
    // Well-known systems are not affected.
    assert!(Projection::new(&Crs::epsg(25832), true).unwrap().remark().is_none());
    // Unsupported methods are rejected.
    assert!(Projection::new(&Crs::epsg(27200), true).is_err());
}

#[test]
fn positions_outside_of_a_projection_have_no_coordinates() {
    let mercator = Projection::new(&Crs::epsg(3857), false).unwrap();
    assert!(mercator.forward([0.0, 91.0]).is_none() && mercator.inverse([f64::NAN, 0.0]).is_none());
    assert!(mercator.forward([0.0, 90.0]).is_none_or(|[_, y]| y > 1e8));
    let zone = Projection::new(&Crs::epsg(32632), false).unwrap();
    assert!(zone.inverse([f64::INFINITY, 0.0]).is_none());
}

/// One system in every form, without an EPSG code: Lambert's conic with two parallels, in US survey
/// feet.
const FORMS: [&str; 6] = [
    // As written by GDAL.
    r#"PROJCS["mine",GEOGCS["NAD83",DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257222101]],
        PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic_2SP"],
        PARAMETER["latitude_of_origin",38.3333333333333],PARAMETER["central_meridian",-111.5],PARAMETER["standard_parallel_1",40.65],
        PARAMETER["standard_parallel_2",39.0166666666667],PARAMETER["false_easting",1640416.66666667],
        PARAMETER["false_northing",6561666.66666667],UNIT["US survey foot",0.304800609601219],AXIS["Easting",EAST],AXIS["Northing",NORTH]]"#,
    // As written by Esri.
    r#"PROJCS["mine",GEOGCS["GCS_North_American_1983",DATUM["D_North_American_1983",SPHEROID["GRS_1980",6378137.0,298.257222101]],
        PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic"],
        PARAMETER["False_Easting",1640416.66666667],PARAMETER["False_Northing",6561666.66666667],PARAMETER["Central_Meridian",-111.5],
        PARAMETER["Standard_Parallel_1",40.65],PARAMETER["Standard_Parallel_2",39.0166666666667],
        PARAMETER["Latitude_Of_Origin",38.3333333333333],UNIT["US_survey_foot",0.304800609601219]]"#,
    // WKT 2:2019, with parameters in other units and with swapped axes.
    r#"PROJCRS["mine",BASEGEOGCRS["NAD83",DATUM["North American Datum 1983",ELLIPSOID["GRS 1980",6378.137,298.257222101,
        LENGTHUNIT["kilometre",1000]]],PRIMEM["Greenwich",0,ANGLEUNIT["degree",0.0174532925199433]]],
        CONVERSION["c",METHOD["Lambert Conic Conformal (2SP)"],
        PARAMETER["Latitude of false origin",42.5925925925926,ANGLEUNIT["grad",0.015707963267949]],
        PARAMETER["Longitude of false origin",-111.5,ANGLEUNIT["degree",0.0174532925199433]],
        PARAMETER["Latitude of 1st standard parallel",40.65],PARAMETER["Latitude of 2nd standard parallel",39.0166666666667],
        PARAMETER["Easting at false origin",500.00000001016,LENGTHUNIT["kilometre",1000]],
        PARAMETER["Northing at false origin",2000000,LENGTHUNIT["metre",1]]],CS[Cartesian,2],
        AXIS["northing",north,ORDER[1],LENGTHUNIT["US survey foot",0.304800609601219]],
        AXIS["easting",east,ORDER[2],LENGTHUNIT["US survey foot",0.304800609601219]],USAGE[SCOPE["x"],AREA["y"],BBOX[1,2,3,4]]]"#,
    r#"{"type":"ProjectedCRS","name":"mine","base_crs":{"name":"NAD83","datum":{"type":"GeodeticReferenceFrame",
        "name":"North American Datum 1983","ellipsoid":{"name":"GRS 1980","semi_major_axis":6378137,"inverse_flattening":298.257222101}}},
        "conversion":{"name":"c","method":{"name":"Lambert Conic Conformal (2SP)"},"parameters":[
        {"name":"Latitude of false origin","value":38.3333333333333,"unit":"degree"},
        {"name":"Longitude of false origin","value":-111.5,"unit":"degree"},
        {"name":"Latitude of 1st standard parallel","value":40.65,"unit":"degree"},
        {"name":"Latitude of 2nd standard parallel","value":39.0166666666667,"unit":"degree"},
        {"name":"Easting at false origin","value":500000.00001016,"unit":"metre"},
        {"name":"Northing at false origin","value":2000000.00001016,"unit":"metre"}]},"coordinate_system":{"subtype":"Cartesian","axis":[
        {"name":"Easting","direction":"east","unit":{"type":"LinearUnit","name":"f","conversion_factor":0.304800609601219}},
        {"name":"Northing","direction":"north","unit":{"type":"LinearUnit","name":"f","conversion_factor":0.304800609601219}}]}}"#,
    "+proj=lcc +lat_0=38.3333333333333 +lon_0=-111.5 +lat_1=40.65 +lat_2=39.0166666666667 +x_0=500000.00001016 +y_0=2000000.00001016 \
     +datum=NAD83 +units=us-ft +no_defs",
    "EPSG:3566",
];

fn of(text: &str) -> spinney_base::Result<Projection> {
    Projection::new(&Crs::parse(text)?, false)
}

fn refusal_of(text: &str) -> String {
    of(text).err().map(|error| error.to_string()).unwrap_or_default()
}

#[test]
fn one_system_is_the_same_in_every_form() {
    // Coordinates of EPSG:3566 computed by PROJ 9.5.1.
    let expected = [1_546_126.195_097, 7_420_261.366_539];
    let place = [-111.84, 40.69];
    for text in FORMS {
        let projection = of(text).unwrap();
        let [x, y] = projection.forward(place).unwrap();
        assert!((x - expected[0]).abs() < 0.003 && (y - expected[1]).abs() < 0.003, "{text}: {x}, {y}");
        let back = projection.inverse([x, y]).unwrap();
        assert!((back[0] - place[0]).abs() < 1e-9 && (back[1] - place[1]).abs() < 1e-9, "{text}: {back:?}");
        assert!(projection.remark().is_none());
    }
}

#[test]
fn datum_shifts_of_definitions_are_read() {
    let wkt1 = r#"GEOGCS["a",DATUM["b",SPHEROID["International 1924",6378388,297],TOWGS84[-87,-98,-121,0.1,-0.2,0.3,4]],
        PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]"#;
    let bound = |method: &str, sign: &str| {
        format!(
            r#"BOUNDCRS[SOURCECRS[GEOGCRS["a",DATUM["b",ELLIPSOID["International 1924",6378388,297]],CS[ellipsoidal,2],
            AXIS["latitude",north],AXIS["longitude",east],ANGLEUNIT["degree",0.0174532925199433]]],
            TARGETCRS[GEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID["WGS 84",6378137,298.257223563]]]],
            ABRIDGEDTRANSFORMATION["t",METHOD["{method}"],PARAMETER["X-axis translation",-87],PARAMETER["Y-axis translation",-98],
            PARAMETER["Z-axis translation",-121],PARAMETER["X-axis rotation",{sign}0.1],
            PARAMETER["Y-axis rotation",{sign}-0.2,ANGLEUNIT["arc-second",4.84813681109536E-06]],
            PARAMETER["Z-axis rotation",{sign}0.3],PARAMETER["Scale difference",1.000004]]]"#
        )
    };
    // Coordinates of the first system computed by PROJ 9.5.1.
    let expected = [5.001_199_587_4, 50.000_795_992_1];
    let strings = [
        wkt1.to_string(),
        bound("Position Vector transformation (geog2D domain)", ""),
        bound("Coordinate Frame rotation (geog2D domain)", "-").replace("--", ""),
        "+proj=longlat +ellps=intl +towgs84=-87,-98,-121,0.1,-0.2,0.3,4".into(),
    ];
    for text in strings {
        let point = of(&text).unwrap().forward([5.0, 50.0]).unwrap();
        assert!(
            (point[0] - expected[0]).abs() < 1e-7 && (point[1] - expected[1]).abs() < 1e-7,
            "{text}: {point:?}"
        );
    }
    // A zero shift still converts between the ellipsoids.
    let nothing = of("+proj=longlat +ellps=intl +towgs84=0,0,0").unwrap().forward([5.0, 50.0]).unwrap();
    assert!((nothing[1] - 50.0).abs() > 1e-5, "{nothing:?}");
}

#[test]
fn definitions_that_are_not_understood_are_refused_by_name() {
    let [gdal, _, wkt2, json, ..] = FORMS;
    for (text, from, to, found) in [
        (gdal, "Conic_2SP", "Conic_2SP_Belgium", "Lambert_Conformal_Conic_2SP_Belgium"),
        (gdal, "North_American_Datum_1983", "North_American_Datum_1927", "North_American_Datum_1927"),
        (gdal, "298.257222101", "297", "another ellipsoid"),
        (gdal, "PRIMEM[\"Greenwich\",0]", "PRIMEM[\"Greenwich\",2]", "another prime meridian"),
        (gdal, "false_easting", "true_easting", "true_easting"),
        (gdal, "PARAMETER[\"central_meridian\",-111.5],", "", "without a longitude"),
        (gdal, "-111.5", "-1e300", "-1e300"),
        (gdal, "40.65", "140.65", "140.65"),
        (gdal, "6378137", "1e300", "an ellipsoid"),
        (gdal, "EAST", "SOUTH", "axes that go south, north"),
        (gdal, "0.304800609601219", "0", "UNIT"),
        (gdal, "AXIS[\"Easting\",EAST]", "EXTENSION[\"PROJ4\",\"+proj=lcc\"]", "EXTENSION"),
        (wkt2, "ANGLEUNIT[\"grad\",0.015707963267949]", "LENGTHUNIT[\"m\",1]", "another kind of unit"),
        (wkt2, "ORDER[1]", "ORDER[2]", "out of their order"),
        (wkt2, "CONVERSION", "DERIVINGCONVERSION", "DERIVINGCONVERSION"),
        (json, "\"ProjectedCRS\"", "\"DerivedProjectedCRS\"", "DerivedProjectedCRS"),
        (json, "\"metre\"", "\"ell\"", "a unit that is not known"),
    ] {
        assert!(text.contains(from), "{from}");
        let refusal = refusal_of(&text.replacen(from, to, 1));
        assert!(refusal.contains(found), "{to}: {refusal}");
    }
    for (text, found) in [
        ("+proj=utm +zone=61 +datum=WGS84", "+zone=61"),
        ("+proj=utm +zone=nan +datum=WGS84", "+zone=nan"),
        ("+proj=utm +datum=WGS84", "without a +zone"),
        ("+proj=nzmg +datum=WGS84", "the method nzmg"),
        ("+proj=laea +lat_0=52 +lat_1=3 +datum=WGS84", "+lat_1=3"),
        ("+proj=laea +lat_0=52 +R_A +datum=WGS84", "+R_A"),
        ("+proj=laea +lat_0=1e400 +datum=WGS84", "+lat_0=1e400"),
        ("+proj=laea +lat_0=52 +ellps=intl", "whose shift to WGS 84 is not known"),
        ("+proj=laea +lat_0=52 +datum=potsdam", "potsdam"),
        ("+proj=laea +lat_0=52 +ellps=intl +nadgrids=a.gsb", "a.gsb"),
        ("+proj=laea +lat_0=52", "no definition of the ellipsoid, or several"),
        ("+proj=laea +lat_0=52 +ellps=WGS84 +towgs84=1,2,nan", "+towgs84=1,2,nan"),
        ("+proj=laea +lat_0=52 +R=1737400 +towgs84=0,0,0", "not the earth"),
        ("+proj=laea +lat_0=52 +datum=WGS84 +axis=neu", "+axis=neu"),
        ("LOCAL_CS[\"site\",UNIT[\"m\",1]]", "LOCAL_CS"),
    ] {
        let refusal = refusal_of(text);
        assert!(refusal.contains(found), "{text}: {refusal}");
    }
    // A ballpark shift accepts any datum, but no other difference.
    let other = gdal.replace("North_American_Datum_1983", "mine");
    let projection = Projection::new(&Crs::parse(&other).unwrap(), true).unwrap();
    assert!(projection.remark().unwrap().contains("the datum mine"));
    assert!(Projection::new(&Crs::parse(&gdal.replace("2SP", "3SP")).unwrap(), true).is_err());
}

#[test]
fn axes_turned_south_and_west() {
    let text = r#"PROJCS["Lo15",GEOGCS["Hartebeesthoek94",DATUM["Hartebeesthoek94",SPHEROID["WGS 84",6378137,298.257223563]],
        PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator_South_Orientated"],
        PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",15],PARAMETER["scale_factor",1],
        PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1]]"#;
    let numbered = Projection::new(&Crs::epsg(2046), false).unwrap().forward([14.4, -22.9]).unwrap();
    let point = of(text).unwrap().forward([14.4, -22.9]).unwrap();
    assert!((0..2).all(|axis| (point[axis] - numbered[axis]).abs() < 1e-6), "{point:?}, not {numbered:?}");
    assert!(point[0] > 0.0 && point[1] > 0.0);
    let polar = |axes: &str| {
        of(&format!(
            r#"PROJCRS["a",BASEGEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID["WGS 84",6378137,298.257223563]]],
            CONVERSION["c",METHOD["Polar Stereographic (variant B)"],PARAMETER["Latitude of standard parallel",-71],
            PARAMETER["Longitude of origin",0]],CS[Cartesian,2],{axes},LENGTHUNIT["metre",1]]"#
        ))
    };
    let known = Projection::new(&Crs::epsg(3031), false).unwrap().forward([82.6, -80.6]).unwrap();
    for axes in [
        r#"AXIS["(E)",north,MERIDIAN[90]],AXIS["(N)",north,MERIDIAN[0]]"#,
        r#"AXIS["(N)",north,MERIDIAN[0]],AXIS["(E)",north,MERIDIAN[90]]"#,
    ] {
        let point = polar(axes).unwrap().forward([82.6, -80.6]).unwrap();
        assert!((0..2).all(|axis| (point[axis] - known[axis]).abs() < 1e-6), "{axes}: {point:?}");
    }
    for axes in [
        r#"AXIS["(E)",south,MERIDIAN[90]],AXIS["(N)",south,MERIDIAN[180]]"#,
        r#"AXIS["(a)",north,MERIDIAN[10]],AXIS["(b)",north,MERIDIAN[100]]"#,
    ] {
        assert!(polar(axes).is_err(), "{axes}");
    }
}

/// Keys from entries, as in a file.
fn keys(entries: &[[u16; 4]], doubles: &[f64], strings: &str) -> Crs {
    let directory = [&[[1, 1, 0, entries.len() as u16]], entries].concat();
    Crs::GeoKeys(crate::GeoKeys::new(directory.as_flattened(), doubles, strings.as_bytes()).unwrap())
}

#[test]
fn keys_that_the_user_defines() {
    // EPSG:3035 by its components: with a datum by code, and with one by name.
    let doubles = [52.0, 10.0, 4_321_000.0, 3_210_000.0, 6_378_137.0, 298.257_222_101, f64::NAN];
    let citation = "GCS Name = ETRS89|Datum = European_Terrestrial_Reference_System_1989|Ellipsoid = GRS 1980|Primem = Greenwich||";
    let plane = |latitude: u16| {
        [
            [1024, 0, 1, 1],
            [3072, 0, 1, 32767],
            [3074, 0, 1, 32767],
            [3075, 0, 1, 10],
            [3076, 0, 1, 9001],
            [3082, 34736, 1, 2],
            [3083, 34736, 1, 3],
            [3088, 34736, 1, 1],
            [3089, 34736, 1, latitude],
        ]
    };
    let by_number = [[2048, 0, 1, 4258]];
    let by_datum = [[2048, 0, 1, 32767], [2050, 0, 1, 6258]];
    let by_name = [
        [2048, 0, 1, 32767],
        [2049, 34737, citation.len() as u16, 0],
        [2050, 0, 1, 32767],
        [2057, 34736, 1, 4],
        [2059, 34736, 1, 5],
    ];
    let known = Projection::new(&Crs::epsg(3035), false).unwrap().forward([-21.0, 59.5]).unwrap();
    for base in [&by_number[..], &by_datum, &by_name] {
        let projection =
            Projection::new(&keys(&[base, &plane(0)].concat(), &doubles, citation), false).unwrap();
        let point = projection.forward([-21.0, 59.5]).unwrap();
        assert!((0..2).all(|axis| (point[axis] - known[axis]).abs() < 1e-6), "{base:?}: {point:?}");
    }
    let refusal = |entries: &[[u16; 4]], citation: &str| {
        let crs = keys(entries, &doubles, citation);
        Projection::new(&crs, false).err().map(|error| error.to_string()).unwrap_or_default()
    };
    assert!(refusal(&[&by_number[..], &plane(6)].concat(), "").contains("NaN"));
    assert!(refusal(&[&[[2048, 0, 1, 4267]][..], &plane(0)].concat(), "").contains("EPSG:4267"));
    assert!(refusal(&[&by_name[..], &plane(0)].concat(), "Datum = mine|").contains("the datum mine"));
    let other = [&by_number[..], &[[1024, 0, 1, 1], [3072, 0, 1, 32767], [3075, 0, 1, 26]]].concat();
    assert!(refusal(&other, "").contains("the method with the number 26"));
    let zone = keys(&[[1024, 0, 1, 1], [2048, 0, 1, 4326], [3074, 0, 1, 16133], [3076, 0, 1, 9001]], &[], "");
    let point = Projection::new(&zone, false).unwrap().forward([17.8575, -76.2734]).unwrap();
    assert!(
        (point[0] - 575_662.030_604).abs() < 1e-3 && (point[1] - 1_532_474.146_249).abs() < 1e-3,
        "{point:?}"
    );
}

proptest::proptest! {
    #[test]
    fn no_definition_panics(form in 0usize..5, at in 0.0f64..1.0, length in 0usize..12, new in "[-0-9a-zA-Z\"\\[\\],.+=]{0,8}") {
        let text = FORMS[form];
        let start = text.floor_char_boundary((text.len() as f64 * at) as usize);
        let end = text.floor_char_boundary((start + length).min(text.len()));
        let text = format!("{}{new}{}", &text[..start], &text[end..]);
        if let Ok(crs) = Crs::parse(&text) {
            for ballpark in [false, true] {
                if let Ok(projection) = Projection::new(&crs, ballpark) {
                    let _ = projection.forward([-111.84, 40.69]).and_then(|point| projection.inverse(point));
                    let _ = (projection.forward([0.0, 90.0]), projection.inverse([1e300, -1e300]));
                }
            }
        }
    }
}
