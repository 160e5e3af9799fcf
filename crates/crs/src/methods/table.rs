//! The table of projection methods.

use super::Measure::*;
use super::Need::*;
use super::WordMapping::*;
use super::{EsriName, KROVAK_COLATITUDE, Measure, Method, Need, ParameterKey, ParameterName, Role};

const fn role(word: &'static str, measure: Measure, need: Need, names: &'static [&'static str]) -> Role {
    Role { word, measure, need, names }
}

const NAT_LAT: &[&str] = &[
    "latitudeofnaturalorigin",
    "latitudeoforigin",
    "latitudeoffalseorigin",
    "latitudeofcenter",
    "latitudeofprojectioncentre",
];
const NAT_LON: &[&str] = &[
    "longitudeofnaturalorigin",
    "centralmeridian",
    "longitudeoffalseorigin",
    "longitudeofcenter",
    "longitudeoforigin",
    "longitudeofprojectioncentre",
];
const SCALES: &[&str] = &["scalefactoratnaturalorigin", "scalefactor", "scalefactoratprojectioncentre"];
const PARALLEL_1: &[&str] = &["latitudeof1ststandardparallel", "standardparallel1"];
const PARALLEL_2: &[&str] = &["latitudeof2ndstandardparallel", "standardparallel2"];

const READ_LAT_0: Role = role("lat_0", Angle, Required, NAT_LAT);
const READ_LON_0: Role = role("lon_0", Angle, Required, NAT_LON);
const READ_EQUATOR: Role = role("lat_0", Angle, Only(0.0), NAT_LAT);
const READ_K_0: Role = role("k_0", Scale, Or(1.0), SCALES);
const READ_NO_SCALE: Role = role("k_0", Scale, Only(1.0), SCALES);
const READ_LAT_1: Role = role("lat_1", Angle, Required, PARALLEL_1);
const READ_LAT_2: Role = role("lat_2", Angle, Required, PARALLEL_2);
const READ_LAT_TS: Role = role("lat_ts", Angle, Required, PARALLEL_1);
const READ_FALSE: &[Role] = &[
    role("x_0", Length, Or(0.0), &["falseeasting", "eastingatfalseorigin", "eastingatprojectioncentre"]),
    role("y_0", Length, Or(0.0), &["falsenorthing", "northingatfalseorigin", "northingatprojectioncentre"]),
];
const READ_OBLIQUE: &[Role] = &[
    role("lat_0", Angle, Required, NAT_LAT),
    role("lonc", Angle, Required, NAT_LON),
    role("alpha", Angle, Required, &["azimuthatprojectioncentre", "azimuth"]),
    role("gamma", Angle, Free, &["anglefromrectifiedtoskewgrid", "rectifiedgridangle", "xyplanerotation"]),
    READ_K_0,
];
const READ_ORIGIN: &[Role] = &[READ_LAT_0, READ_LON_0];
const READ_SCALED: &[Role] = &[READ_LAT_0, READ_LON_0, READ_K_0];
const READ_MERIDIAN: &[Role] = &[READ_LON_0];
const READ_PARALLEL: &[Role] = &[READ_LAT_1];
const READ_PARALLELS: &[Role] = &[READ_LAT_1, READ_LAT_2];

const READ_KROVAK: &[Role] = &[
    READ_LAT_0,
    READ_LON_0,
    role("", Angle, Only(KROVAK_COLATITUDE), &["colatitudeofconeaxis", "azimuth"]),
    role("lat_1", Angle, Only(78.5), &["latitudeofpseudostandardparallel", "pseudostandardparallel1"]),
    role("k_0", Scale, Required, &["scalefactoronpseudostandardparallel", "scalefactor"]),
];

const LAT_0: ParameterName = ("lat_0", "Latitude of natural origin", 8801);
const LON_0: ParameterName = ("lon_0", "Longitude of natural origin", 8802);
const K_0: ParameterName = ("k_0", "Scale factor at natural origin", 8805);
const X_0: ParameterName = ("x_0", "False easting", 8806);
const Y_0: ParameterName = ("y_0", "False northing", 8807);
const LAT_TS: ParameterName = ("lat_ts", "Latitude of 1st standard parallel", 8823);
const SCALED: &[ParameterName] = &[LAT_0, LON_0, K_0, X_0, Y_0];
const AT_ORIGIN: &[ParameterName] = &[LAT_0, LON_0, X_0, Y_0];
const AT_MERIDIAN: &[ParameterName] = &[LON_0, X_0, Y_0];
const CONIC: &[ParameterName] = &[
    ("lat_0", "Latitude of false origin", 8821),
    ("lon_0", "Longitude of false origin", 8822),
    ("lat_1", "Latitude of 1st standard parallel", 8823),
    ("lat_2", "Latitude of 2nd standard parallel", 8824),
    ("x_0", "Easting at false origin", 8826),
    ("y_0", "Northing at false origin", 8827),
];
const LAT_C: ParameterName = ("lat_0", "Latitude of projection centre", 8811);
const LON_C: ParameterName = ("lonc", "Longitude of projection centre", 8812);
const ALPHA: ParameterName = ("alpha", "Azimuth at projection centre", 8813);
const GAMMA: ParameterName = ("gamma", "Angle from Rectified to Skew Grid", 8814);
const K_C: ParameterName = ("k_0", "Scale factor at projection centre", 8815);
const KROVAK: &[ParameterName] = &[
    ("lat_0", LAT_C.1, LAT_C.2),
    ("lon_0", "Longitude of origin", 8833),
    ("30.2881397527778", "Co-latitude of cone axis", 1036),
    ("78.5", "Latitude of pseudo standard parallel", 8818),
    ("k_0", "Scale factor on pseudo standard parallel", 8819),
    X_0,
    Y_0,
];

const ESRI_X: EsriName = ("x_0", "False_Easting");
const ESRI_Y: EsriName = ("y_0", "False_Northing");
const ESRI_LON: EsriName = ("lon_0", "Central_Meridian");
const ESRI_LAT: EsriName = ("lat_0", "Latitude_Of_Origin");
const ESRI_K: EsriName = ("k_0", "Scale_Factor");
const ESRI_1: EsriName = ("lat_1", "Standard_Parallel_1");
const ESRI_2: EsriName = ("lat_2", "Standard_Parallel_2");
const ESRI_TS: EsriName = ("lat_ts", "Standard_Parallel_1");
const ESRI_CENTRE: &[EsriName] =
    &[ESRI_X, ESRI_Y, ("lon_0", "Longitude_Of_Center"), ("lat_0", "Latitude_Of_Center")];
const ESRI_SCALED: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_K, ESRI_LAT];
const ESRI_CONIC: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_1, ESRI_2, ESRI_LAT];
const ESRI_ORIGIN: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_LAT];
const ESRI_MERIDIAN: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON];
const ESRI_PARALLEL: &[EsriName] = &[ESRI_X, ESRI_Y, ESRI_LON, ESRI_TS];
const ESRI_OBLIQUE: &[EsriName] = &[
    ESRI_X,
    ESRI_Y,
    ESRI_K,
    ("alpha", "Azimuth"),
    ("lonc", "Longitude_Of_Center"),
    ("lat_0", "Latitude_Of_Center"),
    ("gamma", "XY_Plane_Rotation"),
];

const NATURAL_KEYS: &[ParameterKey] =
    &[("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083), ("k_0", 3092)];
const CENTRE_KEYS: &[ParameterKey] = &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("lat_0", 3089)];
const CONIC_KEYS: &[ParameterKey] =
    &[("lat_1", 3078), ("lat_2", 3079), ("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083)];
const OBLIQUE_KEYS: &[ParameterKey] = &[
    ("x_0", 3082),
    ("y_0", 3083),
    ("lonc", 3088),
    ("lat_0", 3089),
    ("k_0", 3093),
    ("alpha", 3094),
    ("gamma", 3096),
];

/// Creates a method that no format supports yet.
const fn method(words: &'static str) -> Method {
    let (names, roles, parameters, esri_parameters, keys): (&[_], &[_], &[_], &[_], &[_]) =
        (&[], &[], &[], &[], &[]);
    let (form, name, number, esri, key) = (Plain, "", 0, "", 0);
    Method { words, names, form, roles, name, number, parameters, esri, esri_parameters, key, keys }
}

impl Method {
    /// Sets the names in definitions and their meaning.
    const fn read(
        self,
        names: &'static [&'static str],
        form: super::WordMapping,
        roles: &'static [&'static [Role]],
    ) -> Method {
        Method { names, form, roles, ..self }
    }

    /// Sets the name and EPSG code, and those of the parameters.
    const fn wkt(self, name: &'static str, number: u16, parameters: &'static [ParameterName]) -> Method {
        Method { name, number, parameters, ..self }
    }

    /// Sets Esri's names.
    const fn esri(self, esri: &'static str, esri_parameters: &'static [EsriName]) -> Method {
        Method { esri, esri_parameters, ..self }
    }

    /// Sets the numbers of GeoTIFF keys.
    const fn geotiff(self, key: u16, keys: &'static [ParameterKey]) -> Method {
        Method { key, keys, ..self }
    }
}

/// The methods. If several share a number in GeoTIFF keys, the first one is read.
#[rustfmt::skip]
pub(super) const METHODS: &[Method] = &[
    method("+proj=tmerc").read(&["transversemercator", "gausskruger"], Plain, &[READ_SCALED, READ_FALSE]).wkt("Transverse Mercator", 9807, SCALED)
        .esri("Transverse_Mercator", ESRI_SCALED).geotiff(1, NATURAL_KEYS),
    method("+proj=tmerc +axis=wsu").read(&["transversemercatorsouthorientated"], South, &[READ_SCALED, READ_FALSE])
        .wkt("Transverse Mercator (South Orientated)", 9808, SCALED),
    method("+proj=lcc 2").read(&["lambertconicconformal2sp", "lambertconformalconic2sp"], Plain, &[READ_ORIGIN, READ_PARALLELS, READ_FALSE])
        .wkt("Lambert Conic Conformal (2SP)", 9802, CONIC).esri("Lambert_Conformal_Conic", ESRI_CONIC)
        .geotiff(8, &[("lat_1", 3078), ("lat_2", 3079), ("lon_0", 3084), ("lat_0", 3085), ("x_0", 3086), ("y_0", 3087)]),
    method("+proj=lcc 1").read(&["lambertconicconformal1sp", "lambertconformalconic1sp"], OneParallel, &[READ_SCALED, READ_FALSE])
        .wkt("Lambert Conic Conformal (1SP)", 9801, SCALED)
        .esri("Lambert_Conformal_Conic", &[ESRI_X, ESRI_Y, ESRI_LON, ("lat_0", "Standard_Parallel_1"), ESRI_K, ESRI_LAT]).geotiff(9, NATURAL_KEYS),
    method("+proj=lcc")
        .read(&["lambertconformalconic"], OneOrTwoParallels, &[READ_SCALED, READ_PARALLEL, &[role("lat_2", Angle, Free, PARALLEL_2)], READ_FALSE]),
    method("+proj=aea").read(&["albersequalarea", "albersconicequalarea", "albers"], Plain, &[READ_ORIGIN, READ_PARALLELS, READ_FALSE])
        .wkt("Albers Equal Area", 9822, CONIC).esri("Albers", ESRI_CONIC).geotiff(11, CONIC_KEYS),
    method("+proj=eqdc").read(&["equidistantconic"], Plain, &[READ_ORIGIN, READ_PARALLELS, READ_FALSE]).wkt("Equidistant Conic", 1119, CONIC)
        .esri("Equidistant_Conic", ESRI_CONIC).geotiff(13, CONIC_KEYS),
    method("+proj=laea").read(&["lambertazimuthalequalarea"], Plain, &[READ_ORIGIN, READ_FALSE]).wkt("Lambert Azimuthal Equal Area", 9820, AT_ORIGIN)
        .esri("Lambert_Azimuthal_Equal_Area", ESRI_ORIGIN).geotiff(10, CENTRE_KEYS),
    method("+proj=aeqd").read(&["azimuthalequidistant"], Plain, &[READ_ORIGIN, READ_FALSE]).wkt("Azimuthal Equidistant", 1125, AT_ORIGIN)
        .esri("Azimuthal_Equidistant", ESRI_ORIGIN).geotiff(12, CENTRE_KEYS),
    method("+proj=gnom").read(&["gnomonic"], Plain, &[READ_ORIGIN, READ_FALSE]).wkt("Gnomonic", 0, AT_ORIGIN).esri("Gnomonic", ESRI_CENTRE)
        .geotiff(19, CENTRE_KEYS),
    method("+proj=ortho").read(&["orthographic"], Plain, &[READ_ORIGIN, READ_FALSE]).wkt("Orthographic", 9840, AT_ORIGIN).geotiff(21, CENTRE_KEYS),
    method("+proj=sterea").read(&["obliquestereographic", "doublestereographic"], Plain, &[READ_SCALED, READ_FALSE])
        .wkt("Oblique Stereographic", 9809, SCALED).esri("Double_Stereographic", ESRI_SCALED).geotiff(16, NATURAL_KEYS),
    method("+proj=stere").read(&["stereographic"], Plain, &[READ_SCALED, READ_FALSE]).wkt("Stereographic", 0, SCALED)
        .esri("Stereographic", ESRI_SCALED).geotiff(14, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("lat_0", 3089), ("k_0", 3092)]),
    method("+proj=stere parallel")
        .read(&["polarstereographicvariantb", "polarstereographic"], Polar, &[&[role("lat_0", Angle, Required, &["latitudeofstandardparallel",
            "latitudeoforigin", "latitudeofnaturalorigin"]), READ_LON_0, READ_K_0], READ_FALSE])
        .wkt("Polar Stereographic (variant B)", 9829, &[("lat_ts", "Latitude of standard parallel", 8832), ("lon_0", "Longitude of origin", 8833), X_0, Y_0])
        .esri("Stereographic_North_Pole", ESRI_PARALLEL).geotiff(15, &[("lat_ts", 3081), ("x_0", 3082), ("y_0", 3083), ("1", 3092), ("lon_0", 3095)]),
    method("+proj=stere north").read(&["stereographicnorthpole"], Pole(90.0), &[&[READ_LAT_TS, READ_LON_0, READ_NO_SCALE], READ_FALSE]),
    method("+proj=stere south").read(&["stereographicsouthpole"], Pole(-90.0), &[&[READ_LAT_TS, READ_LON_0, READ_NO_SCALE], READ_FALSE]),
    method("+proj=stere pole").read(&["polarstereographicvarianta"], Polar, &[READ_SCALED, READ_FALSE])
        .wkt("Polar Stereographic (variant A)", 9810, SCALED).esri("Stereographic", ESRI_SCALED)
        .geotiff(15, &[("lat_0", 3081), ("x_0", 3082), ("y_0", 3083), ("k_0", 3092), ("lon_0", 3095)]),
    method("+proj=cass").read(&["cassinisoldner", "cassini"], Plain, &[READ_ORIGIN, &[READ_NO_SCALE], READ_FALSE])
        .wkt("Cassini-Soldner", 9806, AT_ORIGIN).esri("Cassini", &[ESRI_X, ESRI_Y, ESRI_LON, ("1", "Scale_Factor"), ESRI_LAT])
        .geotiff(18, &[("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083)]),
    method("+proj=poly").read(&["americanpolyconic", "polyconic"], Plain, &[READ_ORIGIN, &[READ_NO_SCALE], READ_FALSE])
        .wkt("American Polyconic", 9818, AT_ORIGIN).esri("Polyconic", ESRI_ORIGIN)
        .geotiff(22, &[("lon_0", 3080), ("lat_0", 3081), ("x_0", 3082), ("y_0", 3083), ("1", 3092)]),
    method("+proj=omerc +no_uoff")
        .read(&["hotineobliquemercatorvarianta", "hotineobliquemercator", "hotineobliquemercatorazimuthnaturalorigin",
            "rectifiedskeworthomorphicnaturalorigin"], ObliqueOrigin, &[READ_OBLIQUE, READ_FALSE])
        .wkt("Hotine Oblique Mercator (variant A)", 9812, &[LAT_C, LON_C, ALPHA, GAMMA, K_C, X_0, Y_0])
        .esri("Rectified_Skew_Orthomorphic_Natural_Origin", ESRI_OBLIQUE).geotiff(3, OBLIQUE_KEYS),
    method("+proj=omerc")
        .read(&["hotineobliquemercatorvariantb", "hotineobliquemercatorazimuthcenter", "rectifiedskeworthomorphiccenter"], ObliqueCentre, &[READ_OBLIQUE, READ_FALSE])
        .wkt("Hotine Oblique Mercator (variant B)", 9815, &[LAT_C, LON_C, ALPHA, GAMMA, K_C, ("x_0", "Easting at projection centre", 8816), ("y_0",
            "Northing at projection centre", 8817)])
        .esri("Rectified_Skew_Orthomorphic_Center", ESRI_OBLIQUE).geotiff(9815, OBLIQUE_KEYS),
    method("+proj=somerc")
        .wkt("Hotine Oblique Mercator (variant B)", 9815, &[LAT_C, ("lon_0", LON_C.1, LON_C.2), ("90", ALPHA.1, ALPHA.2), ("90", GAMMA.1, GAMMA.2),
            K_C, ("x_0", "Easting at projection centre", 8816), ("y_0", "Northing at projection centre", 8817)])
        .esri("Hotine_Oblique_Mercator_Azimuth_Center", &[ESRI_X, ESRI_Y, ESRI_K, ("90", "Azimuth"), ("lon_0", "Longitude_Of_Center"), ("lat_0", "Latitude_Of_Center")])
        .geotiff(9815, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("lat_0", 3089), ("k_0", 3093), ("90", 3094), ("90", 3096)]),
    method("+proj=krovak")
        .read(&["krovaknorthorientated"], Plain, &[READ_KROVAK, READ_FALSE]).wkt("Krovak (North Orientated)", 1041, KROVAK)
        .esri("Krovak", &[ESRI_X, ESRI_Y, ("78.5", "Pseudo_Standard_Parallel_1"), ESRI_K, ("30.2881397527778", "Azimuth"), ("lon_0", "Longitude_Of_Center"),
            ("lat_0", "Latitude_Of_Center"), ("-1", "X_Scale"), ("1", "Y_Scale"), ("90", "XY_Plane_Rotation")]),
    method("+proj=krovak +axis=swu")
        .read(&["krovak"], Krovak, &[READ_KROVAK, &[role("x_scale", Scale, Or(1.0), &["xscale"]), role("y_scale", Scale, Or(1.0), &["yscale"]),
            role("turn", Angle, Or(0.0), &["xyplanerotation"])], READ_FALSE])
        .wkt("Krovak", 9819, KROVAK)
        .esri("Krovak", &[ESRI_X, ESRI_Y, ("78.5", "Pseudo_Standard_Parallel_1"), ESRI_K, ("30.2881397527778", "Azimuth"), ("lon_0", "Longitude_Of_Center"),
            ("lat_0", "Latitude_Of_Center"), ("1", "X_Scale"), ("1", "Y_Scale"), ("0", "XY_Plane_Rotation")]),
    method("+proj=merc").read(&["mercatorvarianta", "mercator1sp"], Plain, &[&[READ_EQUATOR, READ_LON_0, READ_K_0], READ_FALSE])
        .wkt("Mercator (variant A)", 9804, &[("0", LAT_0.1, LAT_0.2), LON_0, K_0, X_0, Y_0])
        .esri("Mercator", &[ESRI_X, ESRI_Y, ESRI_LON, ("0", "Standard_Parallel_1")])
        .geotiff(7, &[("lon_0", 3080), ("0", 3081), ("x_0", 3082), ("y_0", 3083), ("k_0", 3092)]),
    method("+proj=merc parallel")
        .read(&["mercatorvariantb", "mercator2sp", "mercator"], Plain, &[&[READ_EQUATOR, READ_LAT_TS, READ_LON_0, READ_NO_SCALE], READ_FALSE])
        .wkt("Mercator (variant B)", 9805, &[LAT_TS, LON_0, X_0, Y_0]).esri("Mercator", ESRI_PARALLEL)
        .geotiff(7, &[("lat_ts", 3078), ("lon_0", 3080), ("x_0", 3082), ("y_0", 3083)]),
    method("+proj=webmerc")
        .read(&["popularvisualisationpseudomercator", "mercatorauxiliarysphere"], Plain, &[&[READ_EQUATOR, READ_LON_0, role("lat_ts", Angle,
            Only(0.0), PARALLEL_1), role("", Scale, Only(0.0), &["auxiliaryspheretype"])], READ_FALSE])
        .wkt("Popular Visualisation Pseudo Mercator", 1024, &[("0", LAT_0.1, LAT_0.2), LON_0, X_0, Y_0])
        .esri("Mercator_Auxiliary_Sphere", &[ESRI_X, ESRI_Y, ESRI_LON, ("0", "Standard_Parallel_1"), ("0", "Auxiliary_Sphere_Type")]),
    method("+proj=cea").read(&["lambertcylindricalequalarea", "cylindricalequalarea"], Plain, &[&[READ_EQUATOR, READ_LAT_TS, READ_LON_0], READ_FALSE])
        .wkt("Lambert Cylindrical Equal Area", 9835, &[LAT_TS, LON_0, X_0, Y_0]).esri("Cylindrical_Equal_Area", ESRI_PARALLEL)
        .geotiff(28, &[("lat_ts", 3078), ("lon_0", 3080), ("x_0", 3082), ("y_0", 3083)]),
    method("+proj=cea Behrmann").read(&["behrmann"], Plain, &[&[READ_EQUATOR, role("lat_ts", Angle, Or(30.0), PARALLEL_1), READ_LON_0], READ_FALSE]),
    method("+proj=eqc")
        .read(&["equidistantcylindrical", "equirectangular"], Plain, &[&[role("lat_0", Angle, Only(0.0), NAT_LAT), role("lat_ts", Angle, Or(0.0),
            PARALLEL_1), READ_LON_0], READ_FALSE])
        .wkt("Equidistant Cylindrical", 1028, &[LAT_TS, ("0", LAT_0.1, LAT_0.2), LON_0, X_0, Y_0]).esri("Equidistant_Cylindrical", ESRI_PARALLEL)
        .geotiff(17, &[("lat_ts", 3078), ("x_0", 3082), ("y_0", 3083), ("lon_0", 3088), ("0", 3089)]),
    method("+proj=eqc plate").read(&["platecarree"], Plain, &[READ_MERIDIAN, READ_FALSE]),
    method("+proj=eqearth").read(&["equalearth"], Plain, &[READ_MERIDIAN, READ_FALSE]).wkt("Equal Earth", 1078, AT_MERIDIAN)
        .esri("Equal_Earth", ESRI_MERIDIAN),
    method("+proj=moll").read(&["mollweide"], Plain, &[READ_MERIDIAN, READ_FALSE]).wkt("Mollweide", 0, AT_MERIDIAN).esri("Mollweide", ESRI_MERIDIAN),
    method("+proj=robin").read(&["robinson"], Plain, &[READ_MERIDIAN, READ_FALSE]).wkt("Robinson", 0, AT_MERIDIAN).esri("Robinson", ESRI_MERIDIAN)
        .geotiff(23, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088)]),
    method("+proj=sinu").read(&["sinusoidal"], Plain, &[READ_MERIDIAN, READ_FALSE]).wkt("Sinusoidal", 0, AT_MERIDIAN)
        .esri("Sinusoidal", ESRI_MERIDIAN).geotiff(24, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088)]),
    method("+proj=mill").wkt("Miller Cylindrical", 0, AT_MERIDIAN).esri("Miller_Cylindrical", ESRI_MERIDIAN)
        .geotiff(20, &[("x_0", 3082), ("y_0", 3083), ("lon_0", 3088)]),
];
