//! The memory limit of an operation.

/// The memory limit of an operation. (Only memory that grows with the data counts: the program
/// itself needs some, too.)
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct Memory {
    /// Memory to use, such as 256M or 2G
    #[arg(id = "memory", long, value_name = "BYTES", default_value = "256M", value_parser = parse_bytes)]
    pub(crate) bytes: u64,
}

/// Memory limit, in bytes, of commands without `--memory`.
pub(crate) const DEFAULT_MEMORY: u64 = 256 << 20;

/// Parses a number of bytes: `256M`, `1G`, `1GiB`, `1000000`. Units are powers of 1024.
pub(crate) fn parse_bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').len();
    let (number, unit) = text.split_at(digits);
    let power = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 1,
        "m" | "mb" | "mib" => 2,
        "g" | "gb" | "gib" => 3,
        "t" | "tb" | "tib" => 4,
        _ => return Err("expected the unit K, M, G or T, as in 256M".into()),
    };
    let number: f64 = number.parse().map_err(|_| "expected a number of bytes, such as 256M or 1G")?;
    let bytes = number * 1024f64.powi(power);
    if !(1.0..=1e18).contains(&bytes) { Err("expected 1 to 1e18 bytes".into()) } else { Ok(bytes as u64) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_read() {
        for (text, expected) in [
            ("1", 1),
            ("1000000", 1_000_000),
            ("256M", 256 << 20),
            ("1G", 1 << 30),
            ("1GiB", 1 << 30),
            ("1gb", 1 << 30),
            ("1.5 k", 1536),
            ("2T", 2 << 40),
            ("7B", 7),
        ] {
            assert_eq!(parse_bytes(text), Ok(expected), "{text}");
        }
        for text in ["", "M", "0", "-1", "1X", "1iB", "1e9", "1.2.3", "9999999T", "1 0"] {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
    }
}
