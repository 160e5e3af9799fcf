//! dBASE tables of shapefiles.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use super::encoding::TextEncoding;
use super::feature::{AttributeType, FeatureAttribute, RequestedAttributes};
use super::sidecar;
use spinney_base::{Error, Result};

/// Table whose rows are read in sequence.
pub(super) struct Table {
    input: BufReader<File>,
    path: PathBuf,
    columns: Vec<Column>,
    encoding: TextEncoding,
    pub(super) rows: u64,
    row: Vec<u8>,
}

/// Requested column.
struct Column {
    name: String,
    /// Type letter.
    letter: u8,
    /// Byte range in a row.
    begin: usize,
    end: usize,
    kind: AttributeType,
}

impl Table {
    /// Opens the table of a shapefile; `None` if it does not exist.
    pub(super) fn open_sidecar(path: &Path, wanted: &mut RequestedAttributes) -> Result<Option<Table>> {
        let Some((file, table)) = sidecar::open(path, "dbf")? else { return Ok(None) };
        let named = sidecar::text(path, "cpg")?;
        Table::open(file, &table, named.as_deref(), wanted).map(Some)
    }

    fn open(
        file: File,
        path: &Path,
        encoding: Option<&str>,
        wanted: &mut RequestedAttributes,
    ) -> Result<Table> {
        let mut input = BufReader::with_capacity(1 << 16, file);
        let mut head = [0; 32];
        let cut = |place: &str, cause: std::io::Error| match cause.kind() {
            std::io::ErrorKind::UnexpectedEof => Error::corrupt(path, place, "the end of the file", "more"),
            _ => Error::io(path, "read")(cause),
        };
        input.read_exact(&mut head).map_err(|cause| cut("header", cause))?;
        let rows = u64::from(u32::from_le_bytes([head[4], head[5], head[6], head[7]]));
        let [length, width] = [8, 10].map(|at| usize::from(u16::from_le_bytes([head[at], head[at + 1]])));
        let mut fields = vec![0; length.saturating_sub(32)];
        input.read_exact(&mut fields).map_err(|cause| cut("columns", cause))?;
        let encoding = match encoding.map(TextEncoding::named) {
            None | Some(TextEncoding::Unknown) => TextEncoding::of_dbase(head[29]),
            Some(encoding) => encoding,
        };
        let (mut columns, mut begin) = (Vec::new(), 1);
        for (index, field) in
            fields.as_chunks::<32>().0.iter().take_while(|field| field[0] != b'\r').enumerate()
        {
            let name = field[..11].split(|byte| *byte == 0).next().unwrap_or_default();
            let wrong = |found: String| {
                Error::corrupt(path, format!("column {}", index + 1), found, "a column type of dBASE")
            };
            let name = encoding.decode(name).map_err(&wrong)?.trim().to_owned();
            let end = begin + usize::from(field[16]);
            if end > width {
                return Err(wrong(format!("a field that ends at byte {end} of rows of {width} bytes")));
            }
            if wanted.takes(&name) {
                let kind = match (field[11], field[16], field[17]) {
                    (b'N', _, 0) | (b'I', 4, _) => AttributeType::Integer,
                    (b'N' | b'F', ..) | (b'O' | b'B', 8, _) => AttributeType::Number,
                    (b'C' | b'D', ..) => AttributeType::Text,
                    (b'L', ..) => AttributeType::Boolean,
                    (other, ..) => {
                        let found =
                            format!("the attribute {name}, of type `{}` of dBASE,", other.escape_ascii());
                        return Err(Error::unsupported(path, found, "select other attributes"));
                    }
                };
                columns.push(Column { name, letter: field[11], begin, end, kind });
            }
            begin = end;
        }
        if width == 0 && rows > 0 {
            return Err(Error::corrupt(path, "header", "rows without bytes", "at least the deletion flag"));
        }
        Ok(Table { input, path: path.into(), columns, encoding, rows, row: vec![0; width] })
    }

    /// Returns names and types of the columns.
    pub(super) fn attributes(&self) -> Vec<(String, AttributeType)> {
        self.columns.iter().map(|column| (column.name.clone(), column.kind)).collect()
    }

    /// Reads the values of the next row; `None` if it is deleted. `number` is the feature number,
    /// for messages.
    pub(super) fn step(&mut self, number: u64) -> Result<Option<Vec<FeatureAttribute>>> {
        self.input.read_exact(&mut self.row).map_err(|cause| match cause.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                Error::corrupt(&self.path, format!("feature {number}"), "the end of the file", "its row")
            }
            _ => Error::io(&self.path, "read")(cause),
        })?;
        if self.row[0] == b'*' {
            return Ok(None);
        }
        let value = |column: &Column| {
            let bytes = &self.row[column.begin..column.end];
            let value = value(column.letter, bytes, &self.encoding);
            let value = value.map(|value| match (value, column.kind) {
                (FeatureAttribute::Integer(number), AttributeType::Number) => {
                    FeatureAttribute::Number(number as f64)
                }
                (value, _) => value,
            });
            value.map_err(|found| {
                let place = format!("feature {number}, attribute {}", column.name);
                Error::corrupt(&self.path, place, found, "a value of the column's type")
            })
        };
        self.columns.iter().map(value).collect::<Result<_>>().map(Some)
    }
}

/// Parses a value by its column's type letter.
fn value(letter: u8, bytes: &[u8], encoding: &TextEncoding) -> Result<FeatureAttribute, String> {
    match (letter, bytes) {
        (b'I', &[a, b, c, d]) => {
            return Ok(FeatureAttribute::Integer(i32::from_le_bytes([a, b, c, d]).into()));
        }
        (b'O' | b'B', &[a, b, c, d, e, f, g, h]) => {
            return Ok(FeatureAttribute::Number(f64::from_le_bytes([a, b, c, d, e, f, g, h])));
        }
        _ => {}
    }
    // Empty values consist of spaces; some writers use zeros.
    let end = bytes.iter().rposition(|byte| !matches!(byte, b' ' | 0)).map_or(0, |last| last + 1);
    let bytes = &bytes[..end];
    if letter == b'C' {
        let text = encoding.decode(bytes)?;
        return Ok(if text.is_empty() {
            FeatureAttribute::None
        } else {
            FeatureAttribute::Text(text.into_owned())
        });
    }
    let text = String::from_utf8_lossy(bytes);
    let text = text.trim();
    let wrong = || Err(format!("`{}`", text.chars().take(30).collect::<String>()));
    match letter {
        _ if text.is_empty() => Ok(FeatureAttribute::None),
        b'L' => Ok(match text {
            "T" | "t" | "Y" | "y" => FeatureAttribute::Boolean(true),
            "F" | "f" | "N" | "n" => FeatureAttribute::Boolean(false),
            "?" => FeatureAttribute::None,
            _ => return wrong(),
        }),
        b'D' => Ok(match (text.len(), text.is_ascii()) {
            _ if text.bytes().all(|byte| byte == b'0') => FeatureAttribute::None,
            (8, true) => FeatureAttribute::Text(format!("{}-{}-{}", &text[..4], &text[4..6], &text[6..])),
            _ => return wrong(),
        }),
        // Asterisks mark a number that did not fit.
        _ if text.bytes().all(|byte| byte == b'*') => Ok(FeatureAttribute::None),
        _ => match (text.parse(), text.parse::<f64>()) {
            (Ok(number), _) if !text.contains('.') && letter == b'N' => Ok(FeatureAttribute::Integer(number)),
            (_, Ok(number)) if number.is_finite() => Ok(FeatureAttribute::Number(number)),
            _ => wrong(),
        },
    }
}
