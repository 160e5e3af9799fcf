//! Coordinate reference systems as arguments.

use std::path::Path;

use spinney::Crs;

/// Maximum number of bytes that are read from a file. Definitions are shorter.
const MAX_BYTES: u64 = 2 << 20;

/// Reads a definition, or the file that has it: after `@`, or the path of an existing file if the
/// text is not a definition.
pub(crate) fn parse_crs(text: &str) -> Result<Crs, String> {
    let parse = |text: &str| {
        let parsed = Crs::parse(text).and_then(|crs| crs.check_registered().map(|()| crs));
        parsed.map_err(|error| error.to_string())
    };
    match text.strip_prefix('@') {
        Some(path) => parse(&read(path)?),
        None => parse(text)
            .or_else(|error| if Path::new(text).is_file() { parse(&read(text)?) } else { Err(error) }),
    }
}

fn read(path: &str) -> Result<String, String> {
    use std::io::Read as _;
    let mut definition = String::new();
    let read =
        std::fs::File::open(path).and_then(|file| file.take(MAX_BYTES).read_to_string(&mut definition));
    read.map(|_| definition).map_err(|error| format!("{path}: cannot read: {error}"))
}
