//! Text encodings of tables, which may be declared in sidecar files, or not at all.

use std::borrow::Cow;

use encoding_rs::{Encoding, UTF_8, WINDOWS_1252};
use oem_cp::code_table::DECODING_TABLE_CP_MAP;
use oem_cp::code_table_type::TableType;

/// Text encoding.
#[derive(Clone, Debug)]
pub(super) enum TextEncoding {
    /// Not declared: valid UTF-8 is read as such, other text as Windows-1252 (Western European).
    Unknown,
    /// An encoding of the WHATWG standard.
    Known(&'static Encoding),
    /// A DOS code page: ASCII, and a table of the other characters.
    Dos(&'static TableType),
    /// An unsupported encoding; only ASCII text can be read.
    Other(String),
}

impl TextEncoding {
    /// Returns the encoding that a `.cpg` file declares.
    pub(super) fn named(text: &str) -> TextEncoding {
        let name = text.trim_matches(|c: char| c.is_whitespace() || c == '\0' || c == '\u{feff}');
        // Esri writes code page numbers with various prefixes.
        let lower = name.to_ascii_lowercase();
        let number = ["windows-", "windows", "ansi ", "cp", "oem ", "ibm", "ms", ""]
            .iter()
            .find_map(|before| lower.strip_prefix(before)?.parse().ok());
        let by_number = number.and_then(TextEncoding::numbered);
        let latin =
            lower.strip_prefix("88591").or(lower.strip_prefix("8859-1")).filter(|rest| rest.is_empty());
        match (Encoding::for_label(name.as_bytes()), by_number) {
            _ if latin.is_some() => TextEncoding::Known(WINDOWS_1252),
            _ if name.is_empty() => TextEncoding::Unknown,
            (Some(encoding), _) => TextEncoding::Known(encoding),
            (None, Some(known)) => known,
            (None, None) => TextEncoding::Other(name.chars().take(40).collect()),
        }
    }

    /// Returns the encoding of a Windows or DOS code page.
    fn numbered(number: u32) -> Option<TextEncoding> {
        let label = match number {
            65001 => "utf-8".into(),
            932 => "shift_jis".into(),
            936 => "gbk".into(),
            949 => "euc-kr".into(),
            950 => "big5".into(),
            866 | 874 => format!("{}{number}", if number == 866 { "ibm" } else { "windows-" }),
            1250..=1258 => format!("windows-{number}"),
            20866 => "koi8-r".into(),
            28591..=28606 => format!("iso-8859-{}", number - 28590),
            _ => {
                let table = DECODING_TABLE_CP_MAP.get(&u16::try_from(number).ok()?)?;
                return Some(TextEncoding::Dos(table));
            }
        };
        Encoding::for_label(label.as_bytes()).map(TextEncoding::Known)
    }

    /// Returns the encoding for the language driver in a dBASE header.
    pub(super) fn of_dbase(language: u8) -> TextEncoding {
        let page = match language {
            0x00 | 0x57 => return TextEncoding::Unknown,
            0x01 | 0x09 | 0x0b | 0x0d | 0x0f | 0x11 | 0x15 | 0x18 | 0x19 | 0x1b => 437,
            0x02 | 0x0a | 0x0e | 0x10 | 0x12 | 0x14 | 0x16 | 0x1a | 0x1d | 0x25 | 0x37 => 850,
            0x1f | 0x22 | 0x23 | 0x40 | 0x64 | 0x87 => 852,
            0x08 | 0x17 | 0x66 => 865,
            0x24 => 860,
            0x67 => 861,
            0x1c | 0x6c => 863,
            0x6a | 0x86 => 737,
            0x6b | 0x88 => 857,
            0x03 | 0x58 | 0x59 => 1252,
            0x13 | 0x7b => 932,
            0x4d | 0x7a => 936,
            0x4e | 0x79 => 949,
            0x4f | 0x78 => 950,
            0x26 | 0x65 => 866,
            0x50 | 0x7c => 874,
            0xc8 => 1250,
            0xc9 => 1251,
            0xca => 1254,
            0xcb => 1253,
            0xcc => 1257,
            other => return TextEncoding::Other(format!("with dBASE language number {other}")),
        };
        TextEncoding::numbered(page).unwrap_or(TextEncoding::Unknown)
    }

    /// Decodes a string, or returns an error message. Invalid bytes become U+FFFD.
    pub(super) fn decode<'b>(&self, bytes: &'b [u8]) -> Result<Cow<'b, str>, String> {
        match (self, std::str::from_utf8(bytes)) {
            (TextEncoding::Known(encoding), _) => Ok(encoding.decode_without_bom_handling(bytes).0),
            (TextEncoding::Unknown, Ok(text)) => Ok(text.into()),
            (TextEncoding::Unknown, Err(error)) => {
                // A field may end within a UTF-8 sequence.
                let encoding = if error.error_len().is_none() { UTF_8 } else { WINDOWS_1252 };
                Ok(encoding.decode_without_bom_handling(bytes).0)
            }
            (TextEncoding::Dos(_) | TextEncoding::Other(_), Ok(text)) if text.is_ascii() => Ok(text.into()),
            (TextEncoding::Dos(table), _) => Ok(table.decode_string_lossy(bytes).into()),
            (TextEncoding::Other(name), _) => Err(format!("text in the unknown encoding {name}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_are_known_by_their_names() {
        let read = |name: &str, bytes: &[u8]| TextEncoding::named(name).decode(bytes).map(Cow::into_owned);
        for (name, bytes, text) in [
            ("UTF-8", "Zürich".as_bytes(), "Zürich"),
            ("65001", "Zürich".as_bytes(), "Zürich"),
            ("", "Zürich".as_bytes(), "Zürich"),
            ("", b"Z\xfcrich", "Zürich"),
            ("ISO-8859-1", b"Z\xfcrich", "Zürich"),
            ("88591", b"Z\xfcrich", "Zürich"),
            ("1252\r\n", b"\x80", "€"),
            ("ANSI 1251", b"\xcc\xee\xf1\xea\xe2\xe0", "Москва"),
            ("CP936", b"\xb1\xb1\xbe\xa9", "北京"),
            ("Shift_JIS", b"\x93\x8c\x8b\x9e", "東京"),
            ("CP850", b"plain", "plain"),
            ("CP850", b"Z\x81rich \x9b", "Zürich ø"),
            ("437", b"Z\x81rich \x9b", "Zürich ¢"),
            ("IBM852", b"\x9d\xa2d\xab", "Łódź"),
            ("OEM 865", b"\x9d", "Ø"),
            ("CP720000", b"plain", "plain"),
        ] {
            assert_eq!(read(name, bytes).as_deref(), Ok(text), "{name}");
        }
        assert!(read("CP720000", b"Z\x81rich").is_err_and(|error| error.contains("CP720000")));
        // The table's language driver, as in GDAL and dBASE.
        for (language, byte, letter) in [
            (0xc9, 0xcc, "М"),
            (0x01, 0x9b, "¢"),
            (0x02, 0x9b, "ø"),
            (0x37, 0x9d, "Ø"),
            (0x64, 0x9d, "Ł"),
            (0x6a, 0x80, "Α"),
        ] {
            assert_eq!(TextEncoding::of_dbase(language).decode(&[byte]).unwrap(), letter, "{language}");
        }
    }
}
