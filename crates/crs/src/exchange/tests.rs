use crate::{Crs, GeoKeys, Transformation};

/// Polar stereographic on an unnamed ellipsoid, as in NSIDC's files.
fn polar_keys() -> Crs {
    let directory = [
        [1, 1, 0, 13],
        [1024, 0, 1, 1],
        [1026, 34737, 8, 0],
        [2048, 0, 1, 32767],
        [2049, 34737, 68, 8],
        [2050, 0, 1, 32767],
        [2054, 0, 1, 9102],
        [2057, 34736, 1, 0],
        [2059, 34736, 1, 1],
        [3072, 0, 1, 32767],
        [3074, 0, 1, 32767],
        [3075, 0, 1, 15],
        [3081, 34736, 1, 2],
        [3095, 34736, 1, 3],
    ];
    let text = b"unknown|GCS Name = unknown|Datum = unknown|Ellipsoid = unknown|Primem = Greenwich|";
    let doubles = [6_378_273.0, 298.279_411_123_064, -70.0, 0.0];
    Crs::GeoKeys(GeoKeys::new(directory.as_flattened(), &doubles, text).unwrap())
}

#[test]
fn keys_by_parameters_become_wkt2() {
    let text = polar_keys().to_wkt2().unwrap();
    for part in [
        "PROJCRS[\"unknown\",BASEGEOGCRS[\"unknown\",DATUM[\"unknown\",ELLIPSOID[\"unknown\",6378273,298.279411123064,",
        "METHOD[\"Polar Stereographic (variant B)\",ID[\"EPSG\",9829]]",
        "PARAMETER[\"Latitude of standard parallel\",-70,",
        "CS[Cartesian,2],AXIS[\"easting (E)\",north,ORDER[1],LENGTHUNIT[\"metre\",1,",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // The output is read as the same system and written unchanged.
    let again = Crs::parse(&text).unwrap();
    assert_eq!(again.to_wkt2().unwrap(), text);
    assert_eq!(polar_keys().to_text().unwrap(), text);
}

#[test]
fn each_form_becomes_the_same_wkt2() {
    let proj = "+proj=tmerc +lat_0=0 +lon_0=9.5 +k=0.9999 +x_0=123456 +y_0=0 +ellps=bessel +towgs84=598,73,418,0.2,0.045,-2.4,6.7";
    let expected = Crs::parse(proj).unwrap().to_wkt2().unwrap();
    assert!(expected.starts_with("BOUNDCRS[SOURCECRS[PROJCRS["), "{expected}");
    assert!(expected.contains("PARAMETER[\"Scale difference\",1.0000067,ID[\"EPSG\",8611]]"), "{expected}");
    let old = "PROJCS[\"unknown\",GEOGCS[\"unknown\",DATUM[\"Unknown based on Bessel 1841 ellipsoid\",SPHEROID[\"Bessel 1841\",6377397.155,\
               299.1528128],TOWGS84[598,73,418,0.2,0.045,-2.4,6.7]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],\
               PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",9.5],\
               PARAMETER[\"scale_factor\",0.9999],PARAMETER[\"false_easting\",123456],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1]]";
    assert_eq!(Crs::parse(old).unwrap().to_wkt2().unwrap(), expected);
    let keys = Crs::GeoKeys(Crs::parse(proj).unwrap().to_geo_keys().unwrap());
    assert_eq!(keys.to_wkt2().unwrap(), expected);
    let other = Crs::parse(&proj.replace("9.5", "9")).unwrap();
    for crs in [proj, old, &expected] {
        let crs = Crs::parse(crs).unwrap();
        assert!(crs.is_same(&keys) && keys.is_same(&crs) && !crs.is_same(&other), "{crs}");
    }
}

#[test]
fn numbers_stay_short_and_have_parts() {
    assert_eq!(Crs::epsg(32633).to_text().unwrap(), "EPSG:32633");
    let text = Crs::epsg(32633).to_wkt2().unwrap();
    assert!(text.starts_with(
        "PROJCRS[\"WGS 84 / UTM zone 33N\",BASEGEOGCRS[\"WGS 84\",DATUM[\"World Geodetic System 1984\""
    ));
    assert!(text.ends_with(",ID[\"EPSG\",32633]]"), "{text}");
    // Northings first, as in the registry.
    let text = Crs::epsg(31467).to_wkt2().unwrap();
    assert!(text.contains("AXIS[\"northing (N)\",north,ORDER[1]"), "{text}");
    let compound = Crs::parse("EPSG:25832+5783").unwrap();
    assert_eq!(compound.to_text().unwrap(), "EPSG:25832+5783");
    let text = compound.to_wkt2().unwrap();
    assert!(
        text.starts_with("COMPOUNDCRS[") && text.contains("VERTCRS[\"DHHN92 height\",VDATUM[\"Deutsches"),
        "{text}"
    );
}

#[test]
fn heights_of_keys_are_kept() {
    // A unit that the system does not have: feet above EGM2008, in a projected system with an EPSG
    // code.
    let entries = [
        [1, 1, 1, 5],
        [1024, 0, 1, 1],
        [3072, 0, 1, 26711],
        [4096, 0, 1, 32767],
        [4098, 0, 1, 1027],
        [4099, 0, 1, 9002],
    ];
    let keys = Crs::GeoKeys(GeoKeys::new(entries.as_flattened(), &[], b"").unwrap());
    assert_eq!(keys.numbers(), None);
    let text = keys.to_wkt2().unwrap();
    assert!(
        text.contains("ID[\"EPSG\",26711]],VERTCRS[\"EGM2008 height\",VDATUM[\"EGM2008 geoid\"]"),
        "{text}"
    );
    assert!(text.contains("up,LENGTHUNIT[\"foot\",0.3048,ID[\"EPSG\",9002]]]]"), "{text}");
    // Heights above the ellipsoid are a third axis.
    let entries = [[1, 1, 1, 3], [1024, 0, 1, 1], [3072, 0, 1, 32631], [4096, 0, 1, 4979]];
    let text = Crs::GeoKeys(GeoKeys::new(entries.as_flattened(), &[], b"").unwrap()).to_wkt2().unwrap();
    assert!(
        text.contains("CS[Cartesian,3]") && text.contains("AXIS[\"ellipsoidal height (h)\",up,ORDER[3]"),
        "{text}"
    );
}

#[test]
fn esri_wkt_is_exported() {
    let text = Crs::epsg(2263).to_esri_wkt().unwrap();
    let expected = "GEOGCS[\"GCS_North_American_1983\",DATUM[\"D_North_American_1983\",SPHEROID[\"GRS_1980\",6378137,298.257222101]],\
                    PRIMEM[\"Greenwich\",0],UNIT[\"Degree\",0.017453292519943295]],PROJECTION[\"Lambert_Conformal_Conic\"]";
    assert!(text.contains(expected), "{text}");
    assert!(text.ends_with("UNIT[\"Foot_US\",0.3048006096012192]]"), "{text}");
    assert!(Crs::parse(&text).is_ok());
}

/// `.prj` files as written by ArcGIS are recognized as systems of the registry, and their
/// coordinates match PROJ 9.5.1.
#[test]
fn files_of_esri_are_systems_of_the_registry() {
    let krovak = |x: i8, turn: u8| {
        format!(
            "PROJCS[\"S-JTSK_Krovak\",GEOGCS[\"GCS_S_JTSK\",DATUM[\"D_S_JTSK\",SPHEROID[\"Bessel_1841\",6377397.155,299.1528128]],\
             PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],PROJECTION[\"Krovak\"],PARAMETER[\"False_Easting\",0.0],\
             PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Pseudo_Standard_Parallel_1\",78.5],PARAMETER[\"Scale_Factor\",0.9999],\
             PARAMETER[\"Azimuth\",30.28813975277778],PARAMETER[\"Longitude_Of_Center\",24.83333333333333],\
             PARAMETER[\"Latitude_Of_Center\",49.5],PARAMETER[\"X_Scale\",{x}.0],PARAMETER[\"Y_Scale\",1.0],\
             PARAMETER[\"XY_Plane_Rotation\",{turn}.0],UNIT[\"Meter\",1.0]]"
        )
    };
    let behrmann = |more: &str| {
        format!(
            "PROJCS[\"World\",GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",SPHEROID[\"WGS_1984\",6378137.0,298.257223563]],\
             PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],PROJECTION[\"Behrmann\"],PARAMETER[\"False_Easting\",0.0],\
             PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",0.0]{more},UNIT[\"Meter\",1.0]]"
        )
    };
    let parallel = ",PARAMETER[\"Standard_Parallel_1\",30.0]";
    for (text, number, degrees, place) in [
        (krovak(-1, 90), 5514, 4156, [-703_105.689_937, -1_058_219.600_826]),
        (krovak(1, 0), 5513, 4156, [1_058_219.600_826, 703_105.689_937]),
        (behrmann(parallel), 6933, 4326, [1_447_294.203_763, 5_614_050.103_061]),
        (behrmann(""), 6933, 4326, [1_447_294.203_763, 5_614_050.103_061]),
    ] {
        let (read, known) = (Crs::parse(&text).unwrap(), Crs::epsg(number));
        assert!(read.is_same(&known) && known.is_same(&read), "{number}");
        let written = known.to_esri_wkt().unwrap();
        assert!(Crs::parse(&written).unwrap().is_same(&known), "{written}");
        // (From degrees in the same datum: such files define no datum shift.)
        let from = &text[text.find("GEOGCS").unwrap()..text.find(",PROJECTION").unwrap()];
        let same = Crs::parse(&read.to_wkt2().unwrap()).unwrap();
        for (from, crs) in [
            (Crs::parse(from).unwrap(), &read),
            (Crs::parse(from).unwrap(), &same),
            (Crs::epsg(degrees), &known),
        ] {
            let found = Transformation::new(&from, crs, true).unwrap().forward([15.0, 50.0]).unwrap();
            assert!(found.iter().zip(place).all(|(a, b)| (a - b).abs() < 1e-3), "{number}: {found:?}");
        }
    }
    // In GDAL's variant the axes decide.
    let gdal = |axes: &str| {
        let esri = krovak(1, 0).replace(",UNIT[\"Meter\",1.0]]", &format!(",UNIT[\"metre\",1]{axes}]"));
        let gone =
            ",PARAMETER[\"X_Scale\",1.0],PARAMETER[\"Y_Scale\",1.0],PARAMETER[\"XY_Plane_Rotation\",0.0]";
        Crs::parse(&esri.replace(gone, "")).unwrap()
    };
    assert!(gdal(",AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH]").is_same(&Crs::epsg(5514)));
    assert!(gdal("").is_same(&Crs::epsg(5513)));
    // Other factors and another parallel make other systems.
    let turned = Crs::parse(&krovak(-1, 0)).unwrap();
    assert!(turned.to_wkt2().unwrap_err().to_string().contains("Krovak with axes times -1.0 and 1.0"));
    assert!(
        !Crs::parse(&behrmann(",PARAMETER[\"Standard_Parallel_1\",31.0]")).unwrap().is_same(&Crs::epsg(6933))
    );
}

/// An EPSG code and a definition with the same parameters are the same system; other parameters
/// make another one.
#[test]
fn numbers_and_parameters_are_one_system() {
    for number in [4326, 3857, 25833, 32633, 3035, 2154, 31467, 28992, 27700, 3006, 5514, 2263, 3413] {
        let crs = Crs::epsg(number);
        let esri = crs.to_esri_wkt().unwrap();
        let read = Crs::parse(&esri).unwrap();
        assert_eq!(read.numbers(), None);
        assert!(read.is_same(&crs) && crs.is_same(&read), "{number}: {esri}");
        let other = esri.replacen("UNIT[\"Meter\",1]", "UNIT[\"Foot\",0.3048]", 1);
        assert!(other == esri || !Crs::parse(&other).unwrap().is_same(&crs), "{number}");
    }
    let zone = "+proj=utm +zone=33 +datum=WGS84 +units=m +no_defs";
    assert!(Crs::parse(zone).unwrap().is_same(&Crs::epsg(32633)));
    assert!(!Crs::parse(zone).unwrap().is_same(&Crs::epsg(25833)), "another datum");
    assert!(!Crs::parse(zone).unwrap().is_same(&Crs::parse("EPSG:32633+5773").unwrap()), "heights");
}

#[test]
fn unsupported_definitions_are_reported_and_returned_unchanged() {
    let geos = "PROJCS[\"disk\",GEOGCS[\"x\",DATUM[\"y\",SPHEROID[\"z\",6378137,298]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925]],\
                PROJECTION[\"Geostationary_Satellite\"],PARAMETER[\"satellite_height\",35786023],UNIT[\"metre\",1]]";
    let crs = Crs::parse(geos).unwrap();
    let message = crs.to_wkt2().unwrap_err().to_string();
    assert!(message.contains("disk") && message.contains("Geostationary_Satellite"), "{message}");
    assert_eq!(crs.foreign_text().as_deref(), Some(geos));
    let entries = [[1, 1, 0, 3], [1024, 0, 1, 1], [3072, 0, 1, 32767], [3075, 0, 1, 99]];
    let keys = Crs::GeoKeys(GeoKeys::new(entries.as_flattened(), &[], b"").unwrap());
    assert!(keys.to_text().is_err() && keys.foreign_text().is_none());
}

#[test]
fn names_cannot_break_out_of_their_quotes() {
    let name = "a\"],ID[\"EPSG\",4326]\n\u{7}b";
    let text = format!(
        "GEOGCS[\"{}\",DATUM[\"d\",SPHEROID[\"e\",6378137,298]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.017453292519943295]]",
        name.replace('"', "\"\"")
    );
    let written = Crs::parse(&text).unwrap().to_wkt2().unwrap();
    let again = Crs::parse(&written).unwrap();
    assert_eq!((again.numbers(), again.name().as_deref()), (None, Some("a\"],ID[\"EPSG\",4326]  b")));
}
