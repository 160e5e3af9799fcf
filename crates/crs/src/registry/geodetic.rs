//! Ellipsoids and prime meridians of the EPSG registry, with Esri's names. Made by `benches/peers/registry.py geodetic`, with PROJ 9.5.1.

/// An ellipsoid.
#[derive(Debug)]
pub(crate) struct Ellipsoid {
    pub(crate) number: u16,
    pub(crate) name: &'static str,
    /// Esri's name, where it is not the other one with underscores.
    esri: &'static str,
    /// Half axis in metres.
    pub(crate) size: f64,
    /// That of spheres is 0.
    pub(crate) inverse_flattening: f64,
}

impl Ellipsoid {
    /// The ellipsoid with a half axis in metres and an inverse flattening.
    pub(crate) fn of_size(size: f64, inverse_flattening: f64) -> Option<&'static Ellipsoid> {
        let is_same = |a: f64, b: f64| (a - b).abs() <= 1e-10 * b;
        ELLIPSOIDS
            .iter()
            .find(|known| is_same(size, known.size) && is_same(inverse_flattening, known.inverse_flattening))
    }

    /// The ellipsoid with a number.
    pub(crate) fn find(number: u16) -> Option<&'static Ellipsoid> {
        ELLIPSOIDS.iter().find(|known| known.number == number)
    }

    pub(crate) fn esri_name(&self) -> String {
        esri_name(self.esri, self.name)
    }
}

/// Name of a prime meridian at so many degrees.
pub(crate) fn meridian_at(degrees: f64) -> Option<&'static str> {
    MERIDIANS.iter().find(|(_, _, own)| (own - degrees).abs() < 1e-9).map(|(_, name, _)| *name)
}

/// Name and longitude of a prime meridian by its number.
pub(crate) fn meridian_numbered(number: u16) -> Option<(&'static str, f64)> {
    MERIDIANS.iter().find(|(own, ..)| *own == number).map(|(_, name, degrees)| (*name, *degrees))
}

/// Esri's own name, or a name with underscores.
pub(crate) fn esri_name(own: &str, name: &str) -> String {
    if !own.is_empty() {
        return own.into();
    }
    let mut text = String::new();
    for c in name.chars() {
        match c.is_ascii_alphanumeric() {
            true => text.push(c),
            false if text.ends_with('_') => {}
            false => text.push('_'),
        }
    }
    text.trim_matches('_').into()
}

const fn ellipsoid(
    number: u16,
    name: &'static str,
    esri: &'static str,
    size: f64,
    inverse_flattening: f64,
) -> Ellipsoid {
    Ellipsoid { number, name, esri, size, inverse_flattening }
}

#[rustfmt::skip]
const ELLIPSOIDS: &[Ellipsoid] = &[
    ellipsoid(1024, "CGCS2000", "", 6378137.0, 298.257222101), ellipsoid(1025, "GSK-2011", "GSK-2011", 6378136.5, 298.2564151),
    ellipsoid(1026, "Zach 1812", "", 6376045.0, 310.0), ellipsoid(7001, "Airy 1830", "", 6377563.396, 299.3249646),
    ellipsoid(7002, "Airy Modified 1849", "Airy_Modified", 6377340.189, 299.3249646),
    ellipsoid(7003, "Australian National Spheroid", "Australian", 6378160.0, 298.25),
    ellipsoid(7004, "Bessel 1841", "", 6377397.155, 299.1528128), ellipsoid(7005, "Bessel Modified", "", 6377492.018, 299.1528128),
    ellipsoid(7007, "Clarke 1858", "", 6378293.645208759, 294.26067636926064),
    ellipsoid(7008, "Clarke 1866", "", 6378206.4, 294.9786982138982),
    ellipsoid(7009, "Clarke 1866 Michigan", "", 6378450.047548891, 294.97869716467693),
    ellipsoid(7010, "Clarke 1880 (Benoit)", "", 6378300.789, 293.4663155389811),
    ellipsoid(7011, "Clarke 1880 (IGN)", "", 6378249.2, 293.4660212936269), ellipsoid(7012, "Clarke 1880 (RGS)", "", 6378249.145, 293.465),
    ellipsoid(7013, "Clarke 1880 (Arc)", "", 6378249.145, 293.4663077),
    ellipsoid(7014, "Clarke 1880 (SGA 1922)", "Clarke_1880_SGA", 6378249.2, 293.46598),
    ellipsoid(7015, "Everest 1830 (1937 Adjustment)", "Everest_Adjustment_1937", 6377276.345, 300.8017),
    ellipsoid(7016, "Everest 1830 (1967 Definition)", "Everest_Definition_1967", 6377298.556, 300.8017),
    ellipsoid(7018, "Everest 1830 Modified", "", 6377304.063, 300.8017), ellipsoid(7019, "GRS 1980", "", 6378137.0, 298.257222101),
    ellipsoid(7020, "Helmert 1906", "", 6378200.0, 298.3),
    ellipsoid(7021, "Indonesian National Spheroid", "Indonesian", 6378160.0, 298.247),
    ellipsoid(7022, "International 1924", "", 6378388.0, 297.0), ellipsoid(7024, "Krassowsky 1940", "Krasovsky_1940", 6378245.0, 298.3),
    ellipsoid(7025, "NWL 9D", "", 6378145.0, 298.25), ellipsoid(7027, "Plessis 1817", "", 6376523.0, 308.64),
    ellipsoid(7028, "Struve 1860", "", 6378298.3, 294.73), ellipsoid(7029, "War Office", "", 6378300.0, 296.0),
    ellipsoid(7030, "WGS 84", "WGS_1984", 6378137.0, 298.257223563), ellipsoid(7031, "GEM 10C", "", 6378137.0, 298.257223563),
    ellipsoid(7032, "OSU86F", "OSU_86F", 6378136.2, 298.257223563), ellipsoid(7033, "OSU91A", "OSU_91A", 6378136.3, 298.257223563),
    ellipsoid(7034, "Clarke 1880", "", 6378249.144808011, 293.46630765563646), ellipsoid(7035, "Sphere", "", 6371000.0, 0.0),
    ellipsoid(7036, "GRS 1967", "", 6378160.0, 298.247167427),
    ellipsoid(7041, "Average Terrestrial System 1977", "ATS_1977", 6378135.0, 298.257),
    ellipsoid(7042, "Everest (1830 Definition)", "Everest_1830", 6377299.365595381, 300.8017255433682),
    ellipsoid(7043, "WGS 72", "WGS_1972", 6378135.0, 298.26),
    ellipsoid(7044, "Everest 1830 (1962 Definition)", "Everest_Definition_1962", 6377301.243, 300.8017255),
    ellipsoid(7045, "Everest 1830 (1975 Definition)", "Everest_Definition_1975", 6377299.151, 300.8017255),
    ellipsoid(7046, "Bessel Namibia (GLM)", "", 6377483.865280419, 299.1528128),
    ellipsoid(7048, "GRS 1980 Authalic Sphere", "Sphere_GRS_1980_Authalic", 6371007.0, 0.0),
    ellipsoid(7049, "IAG 1975", "Xian_1980", 6378140.0, 298.257),
    ellipsoid(7050, "GRS 1967 Modified", "GRS_1967_Truncated", 6378160.0, 298.25), ellipsoid(7051, "Danish 1876", "", 6377019.27, 300.0),
    ellipsoid(7052, "Clarke 1866 Authalic Sphere", "Sphere_Clarke_1866_Authalic", 6370997.0, 0.0),
    ellipsoid(7053, "Hough 1960", "", 6378270.0, 297.0), ellipsoid(7054, "PZ-90", "PZ_1990", 6378136.0, 298.257839303),
    ellipsoid(7055, "Clarke 1880 (international foot)", "Clarke_1880_Intl_Ft", 6378306.3696, 293.4663076556355),
    ellipsoid(7056, "Everest 1830 (RSO 1969)", "Everest_Modified_1969", 6377295.664, 300.8017),
    ellipsoid(7057, "International 1924 Authalic Sphere", "Sphere_International_1924_Authalic", 6371228.0, 0.0),
    ellipsoid(7058, "Hughes 1980", "", 6378273.0, 298.279411123064),
    ellipsoid(7059, "Popular Visualisation Sphere", "WGS_1984_Major_Auxiliary_Sphere", 6378137.0, 0.0),
];

/// Prime meridians: number, name, degrees east of Greenwich.
#[rustfmt::skip]
const MERIDIANS: &[(u16, &str, f64)] = &[
    (8901, "Greenwich", 0.0), (8902, "Lisbon", -9.13190611111111), (8903, "Paris", 2.33722917), (8904, "Bogota", -74.0809166666667),
    (8905, "Madrid", -3.687375), (8906, "Rome", 12.4523333333333), (8907, "Bern", 7.43958333333333), (8908, "Jakarta", 106.807719444444),
    (8909, "Ferro", -17.6666666666667), (8910, "Brussels", 4.367975), (8911, "Stockholm", 18.0582777777778), (8912, "Athens", 23.7163375),
    (8913, "Oslo", 10.7229166666667), (8914, "Paris RGS", 2.33720833333333),
];
