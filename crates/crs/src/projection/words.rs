//! Access to the words of PROJ strings.

/// Returns a parameter of a definition.
pub(super) fn parameter<'a>(definition: &'a str, name: &str) -> Option<&'a str> {
    let mut parts = definition.split_whitespace().filter_map(|part| part.strip_prefix('+')?.split_once('='));
    parts.find(|(own, _)| *own == name).map(|(_, value)| value)
}

/// Returns the definition with its ellipsoid, but without a datum shift.
pub(crate) fn without_shift(definition: &str) -> String {
    let parts = definition.split_whitespace().map(|part| match part {
        // The ellipsoids of named datums.
        "+datum=WGS84" => "+ellps=WGS84",
        "+datum=NAD83" => "+ellps=GRS80",
        "+datum=NAD27" => "+ellps=clrk66",
        "+datum=nzgd49" => "+ellps=intl",
        "+datum=potsdam" | "+datum=hermannskogel" => "+ellps=bessel",
        "+datum=carthage" => "+ellps=clrk80ign",
        "+datum=ire65" => "+ellps=mod_airy",
        "+datum=OSGB36" => "+ellps=airy",
        "+datum=GGRS87" => "+ellps=GRS80",
        part if part.starts_with("+towgs84=") || part.starts_with("+nadgrids=") => "",
        part => part,
    });
    parts.filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}
