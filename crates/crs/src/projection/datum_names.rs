//! Names of datums whose shifts to WGS 84 were compared with PROJ's.

/// Names as normalized by [`key`], and the geographic system of the EPSG registry that has the
/// datum. The table has the datums whose coordinates, at sixty points in each one's area, are
/// within a millimetre of PROJ 9.5.1 without shift grids. For NAD83, Hawaii and the Aleutian
/// Islands were left out, where PROJ shifts by 0.8 m. Names for which PROJ shifts in some regions
/// only are not in the table. The names are those of the registry, GDAL and Esri. Sorted. Generated
/// by `benches/peers/projections.py --datums`.
#[rustfmt::skip]
const KNOWN: &[(&str, u16)] = &[
    ("afgooye", 4205), ("ainelabd1970", 4204), ("albanian1987", 4191), ("americansamoa1962", 4169), ("ammassalik1958", 4196),
    ("anna11965", 4708), ("ascensionisland1958", 4712), ("astro1952", 4711), ("australianantarctic1998", 4176),
    ("australianantarcticdatum1998", 4176), ("autonomousregionsofportugal2008", 5013), ("azorescentralislands1948", 4183),
    ("azoresorientalislands1940", 4184), ("bataviajakarta", 4813), ("beacone1945", 4709), ("beduaram", 4213),
    ("belge1972", 4313), ("bellevue", 4714), ("bellevueign", 4714), ("bermuda2000", 4762),
    ("bhutannationalgeodeticdatum", 5264), ("bioko", 6883), ("bissau", 4165), ("bogota1975bogota", 4802), ("bukitrimpah", 4219),
    ("bulgariageodeticsystem2005", 7798), ("cadastre1997", 4475), ("camparea", 4715), ("campareaastro", 4715),
    ("campoinchauspe", 4221), ("canton1966", 4716), ("capecanaveral", 4717), ("carthage", 4223),
    ("caymanislandsgeodeticdatum2011", 6135), ("centrespatialguyanais1967", 4623), ("ch1903", 4149), ("ch1903bern", 4801),
    ("chathamisland1971", 4672), ("chathamislands1979", 4673), ("chathamislandsdatum1971", 4672),
    ("chathamislandsdatum1979", 4673), ("china2000", 4490), ("cocosislands1965", 4708), ("combani1950", 4632),
    ("conakry1905", 4315), ("croatianterrestrialreferencesystem", 4761), ("crsirgas", 8907), ("csg1967", 4623),
    ("cyprusgeodeticreferencesystem1993", 6311), ("dabola1981", 4155), ("datumgeodesinasional1995", 4755),
    ("dealulpiscului1930", 4316), ("dealulpiscului1933", 4316), ("diegogarcia1969", 4724), ("douala1948", 4192),
    ("easterisland1967", 4719), ("egyptgulfofsuezs650tl", 4706), ("estonia1992", 4133), ("estonia1997", 4180),
    ("etrs1989", 4258), ("european1979", 4668), ("european1987", 4231), ("europeandatum1979", 4668),
    ("europeandatum1987", 4231), ("europeanterrestrialreferencesystem1989", 4258), ("fehmarnbeltdatum2010", 5593),
    ("fiji1956", 4721), ("fiji1986", 4720), ("fijigeodeticdatum1986", 4720), ("fortmarigot", 4621), ("gan1970", 4684),
    ("gda1994", 4283), ("gda2020", 7844), ("gdbd2009", 5246), ("gdm2000", 4742), ("gem10c", 4031),
    ("geocentricdatumbruneidarussalam2009", 5246), ("geocentricdatumofaustralia1994", 4283),
    ("geocentricdatumofaustralia2020", 7844), ("geodeticdatumofmalaysia2000", 4742), ("ggrs1987", 4121),
    ("grandcayman1959", 4723), ("grandcaymangeodeticdatum1959", 4723), ("grandcomoros", 4646),
    ("greekgeodeticreferencesystem1987", 4121), ("greenland1996", 4747), ("grs1980", 4019), ("gunungsegarajakarta", 4820),
    ("hartebeesthoek1994", 4148), ("hartebeesthoek94", 4148), ("helle1954", 4660), ("heratnorth", 4255), ("hjorsey1955", 4658),
    ("hongkong196367", 4739), ("hongkong1980", 4611), ("hongkonggeodetic", 8427), ("hungarian1972", 4237),
    ("hungariandatum1909", 3819), ("hungariandatum1972", 4237), ("hutzushan", 4236), ("hutzushan1950", 4236),
    ("ig05intermediatedatum", 6983), ("igb00", 9009), ("igb08", 9017), ("igm1995", 4670), ("ign1962kerguelen", 4698),
    ("ign53mare", 4641), ("ign56lifou", 4633), ("ign72grandeterre", 4662), ("igs00", 9006), ("igs05", 9012), ("igs08", 9014),
    ("igs14", 9019), ("igs97", 9003), ("internationalterrestrialreferenceframe1988", 8988),
    ("internationalterrestrialreferenceframe1989", 8989), ("internationalterrestrialreferenceframe1991", 8991),
    ("internationalterrestrialreferenceframe1992", 8992), ("internationalterrestrialreferenceframe1993", 8993),
    ("internationalterrestrialreferenceframe1994", 8994), ("internationalterrestrialreferenceframe2000", 8997),
    ("iraqigeospatialreferencesystem", 3889), ("iraqkuwaitboundary1992", 4667), ("iraqkuwaitboundarydatum1992", 4667),
    ("irenet95", 4173), ("islandsnet1993", 4659), ("islandsnet2004", 5324), ("islandsnet2016", 8086),
    ("islandsnetwork1993", 4659), ("islandsnetwork2004", 5324), ("israelgeodeticdatum2005", 7136),
    ("israeligeodeticdatum2005", 7136), ("istitutogeograficomilitaire1995", 4670), ("ists0611968", 4722), ("ists0731969", 4724),
    ("itrf1988", 8988), ("itrf1989", 8989), ("itrf1991", 8991), ("itrf1992", 8992), ("itrf1993", 8993), ("itrf1994", 8994),
    ("itrf2000", 8997), ("iwojima1945", 4709), ("jamaica2001", 4758), ("japanesegeodeticdatum2000", 4612),
    ("japanesegeodeticdatum2011", 6668), ("jgd2000", 4612), ("jgd2011", 6668), ("johnstonisland1961", 4725),
    ("kalianpur1975", 4146), ("kandawala", 4244), ("kartastokoordinaattijarjestelma1966", 4123), ("kerguelenisland1949", 4698),
    ("kertau", 4245), ("kertau1968", 4245), ("kkj", 4123), ("koreageodeticdatum2002", 4737), ("koreandatum1995", 4166),
    ("koreangeodeticdatum2002", 4737), ("kusaie1951", 4735), ("kyrgyzrepublic2006", 7686),
    ("kyrgyzstangeodeticdatum2006", 7686), ("laonationaldatum1997", 4678), ("latvia1992", 4661),
    ("latviangeodeticcoordinatesystem1992", 4661), ("libyangeodeticdatum2006", 4754), ("lithuania1994", 4669),
    ("lithuania1994etrs89", 4669), ("littlecayman1961", 4726), ("macao2008", 8431), ("macaogeodeticdatum2008", 8431),
    ("magna", 4686), ("makassar", 4257), ("makassarjakarta", 4804), ("malongo1987", 4259), ("manoca1962", 4193),
    ("marcogeocentriconacionaldereferencia", 4686), ("marcogeodesiconacional", 5354), ("marcogeodesiconacionaldebolivia", 5354),
    ("marcusisland1952", 4711), ("marshallislands1960", 4732), ("massawa", 4262), ("mauritania1999", 4702),
    ("mexicandatumof1993", 4483), ("mexicoitrf2008", 6365), ("mexicoitrf92", 4483), ("midway1961", 4727), ("moldref99", 4023),
    ("momraterrestrialreferenceframe2000", 8818), ("mop78", 4639), ("moznet", 4130), ("moznetitrf94", 4130),
    ("nad19832011", 6318), ("nad1983cors96", 6783), ("nad1983federalbasenetwork", 8860),
    ("nad1983highaccuracyreferencenetworkcorrected", 8545), ("nad1983ma11", 6325), ("nad1983nsrs2007", 4759),
    ("nad1983pa11", 6322), ("nad83continuouslyoperatingreferencestation1996", 6783), ("nad83federalbasenetwork", 8860),
    ("nad83highaccuracyreferencenetworkcorrected", 8545), ("nad83nationalspatialreferencesystem2007", 4759),
    ("nad83nationalspatialreferencesystem2011", 6318), ("nad83nationalspatialreferencesystemma11", 6325),
    ("nad83nationalspatialreferencesystempa11", 6322), ("naparima1955", 4158), ("nationalgeodeticnetwork", 4318),
    ("nea74noumea", 4644), ("nepal1981", 6207), ("nepalnagarkot", 6207), ("newzealandgeodeticdatum2000", 4167), ("ngn", 4318),
    ("ngo1948", 4273), ("ngo1948oslo", 4817), ("northamerican1983", 4269), ("northamericandatum1983", 4269),
    ("northamericandatumof1983csrs96", 8232), ("northamericandatumof1983csrsversion2", 8237),
    ("northamericandatumof1983csrsversion3", 8240), ("northamericandatumof1983csrsversion4", 8246),
    ("northamericandatumof1983csrsversion5", 8249), ("northamericandatumof1983csrsversion6", 8252),
    ("northamericandatumof1983csrsversion7", 8255), ("notspecifiedbasedongem10cellipsoid", 4031),
    ("notspecifiedbasedongrs1980ellipsoid", 4019), ("notspecifiedbasedonwgs84ellipsoid", 4030),
    ("nouvelletriangulationfrancaise", 4275), ("ntf", 4275), ("nzgd2000", 4167), ("observatario", 4129),
    ("omannationalgeodeticdatum2014", 7373), ("osni1952", 4188), ("papuanewguineageodeticdatum1994", 5546), ("peru96", 5373),
    ("petrels1972", 4636), ("philippinereferencesystem1992", 4683), ("phoenixislands1966", 4716), ("picodelasnieves", 4728),
    ("picodelasnieves1984", 4728), ("pitcairn1967", 4729), ("pitcairn2006", 4763), ("pointegeologieperroud1950", 4637),
    ("popularvisualisationdatum", 4055), ("portosanto1936", 4615), ("posgar1994", 4694), ("posgar1998", 4190),
    ("posicionesgeodesicasargentinas1994", 4694), ("posicionesgeodesicasargentinas1998", 4190), ("ptra08", 5013),
    ("puertorico", 4139), ("qatarnationaldatum1995", 4614), ("qnd1995", 4614), ("rassadiran", 4153),
    ("redgeodesicadecanarias1995", 4081), ("redgeodesicavenezolana", 4189), ("regven", 4189),
    ("reseaudereferencedesantillesfrancaises1991", 4558), ("reseaugeodesiquedelardc2005", 4046),
    ("reseaugeodesiquedelareunion1992", 4627), ("reseaugeodesiquedemayotte2004", 4470),
    ("reseaugeodesiquedesaintpierreetmiquelon2006", 4463), ("reseaugeodesiquedesantillesfrancaises2009", 5489),
    ("reseaugeodesiquedesterresaustralesetantarctiquesfrancaises2007", 7073),
    ("reseaugeodesiquedestpierreetmiquelon2006", 4463), ("reseaugeodesiquedewallisetfutuna1996", 8900),
    ("reseaugeodesiquefrancais1993v1", 4171), ("reseaugeodesiquefrancaisguyane1995", 4624),
    ("reseaugeodesiquenouvellecaledonie1991", 4645), ("reseaunationalbelge1972", 4313), ("retedinamicanazionale2008", 6706),
    ("reunion1947", 4626), ("reykjavik1900", 4657), ("rgf1993", 4171), ("rgfg1995", 4624), ("rgnc1991", 4645),
    ("rgr1992", 4627), ("riketskoordinatsystem1990", 4124), ("rosssearegiongeodeticdatum2000", 4764), ("rraf1991", 4558),
    ("rt1990", 4124), ("saintpierreetmiquelon1950", 4638), ("santo1965", 4730), ("santodos1965", 4730), ("schwarzeck", 4293),
    ("scoresbysund1952", 4195), ("selvagemgrande", 4616), ("selvagemgrande1938", 4616), ("serbianreferencenetwork1998", 4075),
    ("serbianspatialreferencesystem2000", 8685), ("sgnpmarcariosolis", 5371), ("sirgas", 4170), ("sirgas2000", 4674),
    ("sirgaschilerealization1epoch2002", 5360), ("sirgases20078", 5393), ("sirgasrou98", 5381),
    ("sistemadereferenciageocentricoparaamericadelsur1995", 4170), ("sistemadereferenciageocentricoparalasamericas2000", 4674),
    ("sistemageodesiconacionaldepanamamacariosolis", 5371), ("sisterislandsgeodeticdatum1961", 4726), ("sjtsk05", 5228),
    ("sjtsk05ferro", 5229), ("sloveniageodeticdatum1996", 4765), ("southamericandatum196996", 5527),
    ("southgeorgia1968", 4722), ("southyemen", 4164), ("srilankadatum1999", 5233), ("st71belep", 4643),
    ("st84iledespins", 4642), ("st87ouvea", 4750), ("sthelenageodeticdatum2015", 7886), ("sthelenatritan", 7881),
    ("svy21", 4757), ("sweref99", 4619), ("swissterrestrialreferencesystem1995", 4151), ("swisstrf1995", 4151),
    ("systemoftheunifiedtrigonometricalcadastralnetwork05", 5228),
    ("systemoftheunifiedtrigonometricalcadastralnetwork05ferro", 5229),
    ("tahiti1952", 4628), ("tahiti52", 4628),
    ("taiwandatum1997", 3824), ("ternisland1961", 4707), ("tongageodeticdatum2005", 5886), ("trinidad1903", 4302),
    ("tristan1968", 4734), ("turkishnationalreferenceframe", 5252), ("twd1997", 3824), ("vanualevu1915", 4748),
    ("vitilevu1912", 4752), ("voirol1875", 4304), ("wakeeniwetok1960", 4732), ("wakeisland1952", 4733), ("wgs1972", 4322),
    ("wgs1972be", 4324), ("wgs1984", 4326), ("wgs1984majorauxiliarysphere", 4055), ("wgs72transitbroadcastephemeris", 4324),
    ("worldgeodeticsystem1972", 4322), ("worldgeodeticsystem1984", 4326), ("yemennationalgeodeticnetwork1996", 4163),
    ("yemenngn1996", 4163), ("yoff", 4310), ("zanderij", 4311),
];

/// Normalizes a name to lower-case letters and digits, without Esri's prefix `D_` and the
/// registry's suffix `ensemble`.
pub(crate) fn key(name: &str) -> String {
    let name = name.strip_prefix("D_").unwrap_or(name);
    let name = name.strip_suffix(" ensemble").unwrap_or(name);
    crate::methods::key(name)
}

/// Returns the geographic system of the registry that has the datum with a name.
pub(super) fn system_of(name: &str) -> Option<u16> {
    let key = key(name);
    KNOWN.binary_search_by(|(known, _)| (*known).cmp(key.as_str())).ok().map(|index| KNOWN[index].1)
}

/// Whether the table has the datum of a geographic system of the registry.
pub(super) fn is_known(number: u16) -> bool {
    KNOWN.iter().any(|(_, known)| *known == number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_registries_and_programs() {
        for name in
            ["WGS_1984", "D_WGS_1984", "World Geodetic System 1984", "World Geodetic System 1984 ensemble"]
        {
            assert_eq!(system_of(name), Some(4326), "{name}");
        }
        for name in ["North American Datum 1983", "North_American_Datum_1983", "D_North_American_1983"] {
            assert_eq!(system_of(name), Some(4269), "{name}");
        }
        for name in [
            "North American Datum 1927",
            "D_",
            "",
            "unknown",
            "Not specified (based on Bessel 1841 ellipsoid)",
        ] {
            assert_eq!(system_of(name), None, "{name}");
        }
        assert!(KNOWN.is_sorted() && is_known(4326) && !is_known(4267));
    }
}
