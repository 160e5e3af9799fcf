//! Parser of chain codes: the head, and the crossings of chains with rows.

use std::path::Path;

use super::crossings::{Change, Crossing};
use super::text::{Text, shown};
use super::{ChainDirections, MAGIC, VERSION};
use spinney_base::io::FileAccess;
use spinney_base::space::Dimension;
use spinney_base::value::{Number, Palette, SampleType, ValueType};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};

/// Keywords that begin a chain, or end the file.
const BODY: [&str; 5] = ["region", "part", "hole", "line", "end"];
/// Maximum number of palette colours.
const MAX_COLOURS: usize = 1 << 16;

/// The head of a file, before its chains.
pub(super) struct Head {
    pub(super) directions: ChainDirections,
    /// Columns and rows, if the file has them.
    pub(super) size: Option<[u64; 2]>,
    pub(super) sample: SampleType,
    pub(super) frame: Frame,
    pub(super) nodata: Option<Number>,
    pub(super) palette: Option<Palette>,
    pub(super) names: Vec<(Number, String)>,
}

/// A file whose head was read.
pub(super) struct Body {
    text: Text,
    /// The first word after the head.
    first: String,
}

/// Opens a file and reads its head.
///
/// # Errors
/// If it cannot be read, or the head violates the grammar.
pub(super) fn open(path: &Path, access: &FileAccess) -> Result<(Head, Body)> {
    let mut text = Text::open(path, access)?;
    let magic = text.word()?;
    if magic.as_deref() != Some(MAGIC) {
        let found = magic.map_or("no word".into(), |word| shown(word.as_bytes()));
        return Err(text.wrong(&found, &format!("`{MAGIC} {VERSION}`")));
    }
    match text.word()? {
        Some(version) if version == VERSION => {}
        Some(version) => {
            let found = format!("version {} of chain codes", shown(version.as_bytes()));
            return Err(text.unsupported(found, "use a newer program, or write version 1"));
        }
        None => return Err(text.wrong("the end of the file", "version 1")),
    }
    let mut directions = None;
    let mut head = Head {
        directions: ChainDirections::Four,
        size: None,
        sample: SampleType::U8,
        frame: Frame::identity(),
        nodata: None,
        palette: None,
        names: Vec::new(),
    };
    let mut known: Vec<String> = Vec::new();
    let first = loop {
        let Some(word) = text.word()? else {
            return Err(text.wrong("the end of the file", "chains, and `end`"));
        };
        if BODY.contains(&&*word) {
            break word;
        }
        if word != "name" && known.contains(&word) {
            return Err(text.wrong(&format!("a second line `{word}`"), "each header line once"));
        }
        match &*word {
            "directions" => directions = Some(text.number("4 or 8 directions", |word| word.parse().ok())?),
            "size" => head.size = Some([cells(&mut text, "columns")?, cells(&mut text, "rows")?]),
            "type" => {
                let expected = format!("a type: {}", SampleType::ALL.map(SampleType::name).join(", "));
                let named = |word: &str| SampleType::ALL.into_iter().find(|sample| sample.name() == word);
                head.sample = text.number(&expected, named)?;
            }
            "nodata" => head.nodata = Some(text.number("a number", |word| word.parse().ok())?),
            "transform" => head.frame.matrix = transform(&mut text)?,
            "points" => head.frame.pixel_is_point = true,
            "crs" => {
                let definition = text.rest()?;
                head.frame.crs = Some(Crs::parse(&definition).map_err(|error| {
                    text.wrong(&shown(definition.as_bytes()), &format!("a coordinate system ({error})"))
                })?);
            }
            "palette" => head.palette = Some(palette(&mut text)?),
            "name" => {
                let class = text.number("a class", |word| word.parse().ok())?;
                let name = text.rest()?;
                let name = serde_json::from_str(&name)
                    .map_err(|_| text.wrong(&shown(name.as_bytes()), "a name in quotation marks"))?;
                head.names.push((class, name));
            }
            _ => {
                let words = "directions, size, type, nodata, transform, points, crs, palette, name, region, line or end";
                return Err(text.wrong(&shown(word.as_bytes()), words));
            }
        }
        known.push(word);
    };
    let missing = || text.wrong(&format!("`{first}`"), "`directions 4` or `directions 8` before chains");
    head.directions = directions.ok_or_else(missing)?;
    Ok((head, Body { text, first }))
}

/// Parses a number of cells along an axis.
fn cells(text: &mut Text, what: &str) -> Result<u64> {
    let most = 1u64 << Dimension::Quad.max_depth();
    let read = |word: &str| word.parse().ok().filter(|cells| (1..=most).contains(cells));
    text.number(&format!("a number of {what}, from 1 to {most}"), read)
}

/// Parses the six numbers of a transform as a matrix.
fn transform(text: &mut Text) -> Result<[[f64; 4]; 3]> {
    let mut numbers = [0.0; 6];
    for number in &mut numbers {
        let finite = |word: &str| word.parse().ok().filter(|number: &f64| number.is_finite());
        *number = text.number("six numbers that map columns and rows to the world", finite)?;
    }
    let frame = Frame::planar(numbers);
    if frame.to_cells([0.0; 3]).is_none() {
        return Err(text.wrong(&format!("{numbers:?}"), "an invertible map from cells to the world"));
    }
    Ok(frame.matrix)
}

/// Parses the colours of a line.
fn palette(text: &mut Text) -> Result<Palette> {
    let line = text.rest()?;
    let mut colours = Vec::new();
    for word in line.split_ascii_whitespace() {
        let digits = word.strip_prefix('#').filter(|digits| digits.len() == 8);
        let colour = digits.and_then(|digits| u32::from_str_radix(digits, 16).ok());
        match colour {
            Some(colour) if colours.len() < MAX_COLOURS => colours.push(colour.to_be_bytes()),
            Some(_) => return Err(text.wrong("further colours", &format!("at most {MAX_COLOURS} colours"))),
            None => return Err(text.wrong(&shown(word.as_bytes()), "colours, as in #ff8000ff")),
        }
    }
    Ok(Palette { colours })
}

/// Receives crossings in file order.
pub(super) type CrossingVisitor<'a> = dyn FnMut(Crossing) -> Result<()> + 'a;

impl Body {
    /// Traverses all chains.
    ///
    /// # Errors
    /// If the file cannot be read, violates the grammar, or exceeds the raster, or `take` fails.
    pub(super) fn each(self, head: &Head, take: &mut CrossingVisitor<'_>) -> Result<()> {
        let Body { mut text, first } = self;
        let value = ValueType::new(head.sample, 1);
        let class_expected = format!("a class of type {}", head.sample.name());
        let (mut word, mut count, mut class) = (first, 0u64, None);
        loop {
            let is_hole = matches!(&*word, "hole" | "part");
            match &*word {
                "region" | "line" => {
                    let read = |word: &str| {
                        let value_of =
                            |number: Number| value.exact(&[number]).filter(|own| !value.is_nan(*own));
                        word.parse().ok().and_then(value_of)
                    };
                    let found = text.number(&class_expected, read)?.to_bytes();
                    let bits = found.first_chunk::<8>().map_or(0, |bytes| u64::from_le_bytes(*bytes));
                    // Only regions have holes.
                    class = (word == "region").then_some(bits);
                    count += 1;
                    if word == "line" && head.directions == ChainDirections::Four {
                        return Err(
                            text.wrong("a line in a chain code of 4 directions", "8 directions for lines")
                        );
                    }
                    let owner = ChainOwner { number: count, class: bits, is_closed: word == "region" };
                    chain(&mut text, head, &owner, take)?;
                }
                "hole" | "part" if class.is_none() => {
                    return Err(text.wrong(&format!("`{word}`"), "holes and parts after their region"));
                }
                "end" => {
                    if let Some(total) = text.word()?
                        && total.parse() != Ok(count)
                    {
                        return Err(text.wrong(
                            &shown(total.as_bytes()),
                            &format!("{count}, the number of regions and lines"),
                        ));
                    }
                    return match text.word()? {
                        None => Ok(()),
                        Some(more) => Err(text.wrong(&shown(more.as_bytes()), "the end of the file")),
                    };
                }
                _ if !is_hole => {
                    return Err(text.wrong(&shown(word.as_bytes()), "region, part, hole, line or end"));
                }
                _ => {}
            }
            if let (true, Some(class)) = (is_hole, class) {
                chain(&mut text, head, &ChainOwner { number: count, class, is_closed: true }, take)?;
            }
            word = match text.word()? {
                Some(word) => word,
                None => return Err(text.wrong("the end of the file", "`end`: the file is incomplete")),
            };
        }
    }
}

/// The region or line that a chain belongs to.
struct ChainOwner {
    number: u64,
    class: u64,
    /// Whether its chains are closed.
    is_closed: bool,
}

/// Parses a chain: its start and its steps.
fn chain(text: &mut Text, head: &Head, owner: &ChainOwner, take: &mut CrossingVisitor<'_>) -> Result<()> {
    let most = 1u64 << Dimension::Quad.max_depth();
    let is_crack = head.directions == ChainDirections::Four;
    // Corners may be on the last side of the raster, cells may not.
    let ends = head.size.unwrap_or([most; 2]).map(|cells| cells as i64 - i64::from(!is_crack));
    let line = text.line;
    let mut start = [0i64; 2];
    for (axis, what) in ["column", "row"].into_iter().enumerate() {
        let read = |word: &str| word.parse().ok().filter(|at| (0..=ends[axis]).contains(at));
        start[axis] = text.number(&format!("a {what}, from 0 to {}", ends[axis]), read)?;
    }
    let mut tracer = ChainTracer { at: start, owner, run: [start[0]; 2], is_crack };
    while let Some(byte) = text.skip_space()?.filter(u8::is_ascii_digit) {
        let mut code = byte;
        loop {
            let step = head.directions.step(code.wrapping_sub(b'0')).filter(|_| code.is_ascii_digit());
            let Some(step) = step else {
                let expected = format!("codes from 0 to {}", head.directions.count() - 1);
                return Err(text.wrong(&shown(&[code]), &expected));
            };
            let to = [tracer.at[0] + step[0], tracer.at[1] + step[1]];
            if (0..2).any(|axis| !(0..=ends[axis]).contains(&to[axis])) {
                let expected = format!("columns from 0 to {} and rows from 0 to {}", ends[0], ends[1]);
                return Err(text.wrong(&format!("a move to column {}, row {}", to[0], to[1]), &expected));
            }
            tracer.go(to, take)?;
            text.pass();
            match text.peek()?.filter(|byte| !byte.is_ascii_whitespace()) {
                Some(next) => code = next,
                None => break,
            }
        }
    }
    let [column, row] = tracer.at;
    if owner.is_closed && tracer.at != start {
        let expected = format!("column {}, row {}, where it begins", start[0], start[1]);
        return Err(text.wrong_in(
            line,
            &format!("a chain that ends at column {column}, row {row}"),
            &expected,
        ));
    }
    tracer.end(take)
}

/// State of the traversal of a chain.
struct ChainTracer<'a> {
    at: [i64; 2],
    owner: &'a ChainOwner,
    /// First and last cell of the chain in the current row since it entered that row.
    run: [i64; 2],
    is_crack: bool,
}

impl ChainTracer<'_> {
    /// Takes a step.
    ///
    /// Invariant: a row is crossed where a step leaves it downwards or enters it from below, at the
    /// upper end of the step. Cells of the chain belong to the region regardless of crossings. All
    /// other cells next to a step are on one side of it. So a cell that is not on a chain is inside
    /// if an odd number of crossings is at or before it.
    fn go(&mut self, to: [i64; 2], take: &mut CrossingVisitor<'_>) -> Result<()> {
        let from = std::mem::replace(&mut self.at, to);
        if from[1] == to[1] {
            self.run = [self.run[0].min(to[0]), self.run[1].max(to[0])];
            return Ok(());
        }
        let upper = if from[1] < to[1] { from } else { to };
        if !self.is_crack {
            self.take_run(from[1], take)?;
            self.run = [to[0]; 2];
        }
        if self.owner.is_closed {
            self.take(upper[1], upper[0], Change::Cross, take)?;
        }
        Ok(())
    }

    /// Ends the chain.
    fn end(self, take: &mut CrossingVisitor<'_>) -> Result<()> {
        if self.is_crack { Ok(()) } else { self.take_run(self.at[1], take) }
    }

    fn take_run(&self, row: i64, take: &mut CrossingVisitor<'_>) -> Result<()> {
        self.take(row, self.run[0], Change::Begin, take)?;
        self.take(row, self.run[1] + 1, Change::End, take)
    }

    fn take(&self, row: i64, column: i64, change: Change, take: &mut CrossingVisitor<'_>) -> Result<()> {
        let ChainOwner { number, class, .. } = *self.owner;
        // Both are between 0 and 2^29.
        take(Crossing { row: row as u32, column: column as u32, owner: number, change, class })
    }
}

/// Returns the columns and rows that all chains of a file cover.
///
/// # Errors
/// If the file cannot be read, violates the grammar, or has no cells.
pub(super) fn measure(path: &Path, access: &FileAccess) -> Result<[u64; 2]> {
    let (head, body) = open(path, access)?;
    let mut size = [0u64; 2];
    body.each(&head, &mut |crossing| {
        size = [size[0].max(crossing.column.into()), size[1].max(u64::from(crossing.row) + 1)];
        Ok(())
    })?;
    if size[0] == 0 {
        let expected = "a chain around cells, or the line `size COLUMNS ROWS`";
        return Err(Error::corrupt(path, "the whole file", "no cells", expected));
    }
    Ok(size)
}
