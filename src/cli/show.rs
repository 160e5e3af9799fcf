//! `spinney show`: shows a file in the terminal.

use std::env;
use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write as _};

use anyhow::{Context as _, Result, ensure};
use spinney::Dataset;
use spinney::export::{Detail, RenderRequest, WindowRequest, export_window, render, render_exact};
use spinney::raw::export::image::Format;
use spinney::style::Style;

use super::args::{Size, ViewedTree, parse_size, parse_style};
use super::get::default_region;
use super::report::Work;
use super::{Global, exact};

const EXAMPLES: &str = "Examples:
  spinney show world.goblin
  spinney show relief.goblin --style terrain --size 120x40
  spinney show bunny.goblin --view rotate=90,z
  spinney show world.goblin | head                   letters instead of colours

Colours need a terminal with 24-bit colours. If NO_COLOR is set, or the output is not a terminal,
brightness is shown by letters.";

/// Show a file in the terminal
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    /// Columns and rows of the output, at most [default: the terminal's]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Colours: a style's name, its JSON or a file with it: see `spinney get --style` [default: the
    /// tree's own]
    #[arg(long, value_name = "STYLE", value_parser = parse_style)]
    style: Option<Style>,
}

/// Default columns and rows of letters.
const DEFAULT_SIZE: [u64; 2] = [80, 24];
/// Maximum columns and rows.
const MAX_SIZE: u64 = 1000;

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let is_terminal = io::stdout().is_terminal();
    let text_size = match args.size {
        Some(size) => <[u64; 2]>::from(size.of(DEFAULT_SIZE[0], DEFAULT_SIZE[1])),
        None => terminal(),
    };
    let [columns, rows] = text_size.map(|letters| letters.clamp(1, MAX_SIZE));
    // A letter shows two pixels, one above the other.
    let drawn = drawn(args, [columns, 2 * rows.saturating_sub(2).max(1)], global)?;
    let has_colours = is_terminal && env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let text = if has_colours { drawn.colours() } else { drawn.letters() };
    Ok(io::stdout().write_all(text.as_bytes())?)
}

/// Returns columns and rows of the terminal.
#[cfg(unix)]
fn terminal() -> [u64; 2] {
    match rustix::termios::tcgetwinsize(io::stdout()) {
        Ok(size) if size.ws_col > 0 && size.ws_row > 0 => [size.ws_col.into(), size.ws_row.into()],
        _ => DEFAULT_SIZE,
    }
}

#[cfg(not(unix))]
fn terminal() -> [u64; 2] {
    DEFAULT_SIZE
}

/// Pixels: red, green, blue and opacity.
struct Drawing {
    columns: usize,
    pixels: Vec<[u8; 4]>,
}

/// Draws a file's contents, at the size of `text_size`.
fn drawn(args: &Args, text_size: [u64; 2], global: &Global) -> Result<Drawing> {
    let directory = tempfile::tempdir()?;
    let path = directory.path().join("image.raw");
    let work = Work::start(global, "pixels")?;
    let file = args.tree.file.as_path();
    let request = |[columns, rows]: [u64; 2]| {
        let mut request = RenderRequest::new(columns, rows);
        request.background = None;
        request
    };
    let size = if let Some(view) = args.tree.open_model(global)? {
        global.check_options(file, exact::KIND, &["--size", "--view"])?;
        args.tree.warn_of_no_faces(view.as_model("images")?, &work);
        render_exact(
            view.as_model("images")?,
            &request(text_size),
            global.access().create(&path)?,
            Format::Raw,
            &work,
        )?;
        text_size
    } else {
        let tree = args.tree.open_drawn(global)?;
        if tree.header().form.axes() == 3 {
            ensure!(
                args.style.is_none(),
                "--style: has no effect on {}, an octree, which is drawn as a solid",
                file.display()
            );
            args.tree.warn_of_no_cells(&tree, &work)?;
            render(&tree, &request(text_size), global.access().create(&path)?, Format::Raw, &work)?;
            text_size
        } else {
            map(&tree, args.style.as_ref(), text_size, &path, (&work, global))?
        }
    };
    work.finish();
    let bytes = std::fs::read(&path).with_context(|| format!("{}: cannot read", path.display()))?;
    let columns = size[0] as usize;
    let channels = bytes.len() / (columns * size[1] as usize).max(1);
    let pixel = |samples: &[u8]| match *samples {
        [red, green, blue, alpha] => [red, green, blue, alpha],
        [red, green, blue] => [red, green, blue, 255],
        _ => [samples[0], samples[0], samples[0], samples.get(1).copied().unwrap_or(255)],
    };
    Ok(Drawing { columns, pixels: bytes.chunks_exact(channels.max(1)).map(pixel).collect() })
}

/// Draws a quadtree. Returns the image's columns and rows.
fn map(
    tree: &Dataset,
    style: Option<&Style>,
    text_size: [u64; 2],
    path: &std::path::Path,
    (work, global): (&Work, &Global),
) -> Result<[u64; 2]> {
    let bounds = default_region(tree, global)?;
    let [width, height, _] = bounds.size().map(|cells| cells as f64);
    let factor = (text_size[0] as f64 / width).min(text_size[1] as f64 / height);
    let [columns, rows] = [width, height].map(|cells| ((cells * factor).round() as u64).max(1));
    let size = [columns.min(text_size[0]), rows.min(text_size[1])];
    let mut request = WindowRequest::new(bounds, Detail::Size(size[0], size[1]));
    request.style = Some(style.cloned().unwrap_or_else(|| Style::default_for(tree)));
    export_window(tree, &request, global.access().create(path)?, Format::Raw, work)?;
    Ok(size)
}

/// Minimum opacity of visible pixels.
const SEEN: u8 = 128;

impl Drawing {
    /// Returns pairs of pixels, one above the other, for each row of letters.
    fn lines(&self) -> impl Iterator<Item = Vec<[Option<[u8; 3]>; 2]>> {
        let seen = |[red, green, blue, alpha]: [u8; 4]| (alpha >= SEEN).then_some([red, green, blue]);
        self.pixels.chunks(2 * self.columns).map(move |rows| {
            let below = |column: usize| rows.get(self.columns + column).copied().and_then(seen);
            (0..self.columns.min(rows.len())).map(|column| [seen(rows[column]), below(column)]).collect()
        })
    }

    /// Returns text with a colour for each half of a letter.
    fn colours(&self) -> String {
        let mut text = String::new();
        for line in self.lines() {
            let mut before = None;
            for halves in line {
                let letter = match halves {
                    [None, None] => ' ',
                    [None, Some(_)] => '▄',
                    _ => '▀',
                };
                if before != Some(halves) {
                    text.push_str("\x1b[0m");
                    let [above, below] = halves;
                    let (front, back) = if above.is_none() { (below, None) } else { (above, below) };
                    for (code, colour) in [(38, front), (48, back)] {
                        if let Some([red, green, blue]) = colour {
                            let _ = write!(text, "\x1b[{code};2;{red};{green};{blue}m");
                        }
                    }
                    before = Some(halves);
                }
                text.push(letter);
            }
            text.push_str("\x1b[0m\n");
        }
        text
    }

    /// Returns text whose letters are denser for brighter pixels.
    fn letters(&self) -> String {
        const LETTERS: &[u8] = b".:-=+*#%@";
        let light = |[red, green, blue]: [u8; 3]| {
            0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue)
        };
        let letter = |halves: [Option<[u8; 3]>; 2]| {
            let seen: Vec<f64> = halves.into_iter().flatten().map(light).collect();
            if seen.is_empty() {
                return ' ';
            }
            let mean = seen.iter().sum::<f64>() / seen.len() as f64;
            char::from(LETTERS[((mean / 256.0 * LETTERS.len() as f64) as usize).min(LETTERS.len() - 1)])
        };
        let mut text = String::new();
        for line in self.lines() {
            let line: String = line.into_iter().map(letter).collect();
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}
