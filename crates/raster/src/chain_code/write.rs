//! Writer of chain codes: regions of classes, and lines.

use std::io::Write;
use std::path::PathBuf;

use super::line::chains_of;
use super::ring::RingChain;
use super::{ChainDirections, MAGIC, VERSION};
use spinney_base::io::Output;
use spinney_base::value::{Number, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_crs::{Crs, Frame};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ClassRegion, PolygonRequest, PolygonSummary};

/// Steps per line of text.
const LINE: usize = 120;
/// Bytes buffered before a write.
const PART: usize = 1 << 16;

/// Writes the regions of a categorical quadtree as Freeman chain codes. Each region has its class,
/// the start and the steps of its chain, and a chain for each hole. `request` and memory use are
/// those of [polygons](Dataset::polygons), whose borders the chains follow. A region whose polygons
/// touch only at corners has one chain per polygon. With 4 directions chains follow the sides of
/// cells, with 8 they go from cell to cell.
///
/// The file also stores the raster's size, sample type, frame, coordinate system, nodata number,
/// colours and class names, so that a tree built from it has the same cells.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::raw::export::{ChainDirections, export_chain_code};
/// use spinney::Output;
/// use spinney::query::PolygonRequest;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let (text, again) = (directory.path().join("classes.chain"), directory.path().join("again.goblin"));
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// export_chain_code(
///     &map, &PolygonRequest::new(), ChainDirections::Eight, Output::create(&text)?, &())?;
///
/// spinney::build(&text, &again)?;
/// assert_eq!(
///     spinney::open(&again)?.statistics(None, &())?.classes, map.statistics(None, &())?.classes);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// Those of [`Dataset::polygons`]; if borders are to be simplified, or the output cannot be
/// written.
pub fn export_chain_code(
    tree: &Dataset,
    request: &PolygonRequest,
    directions: ChainDirections,
    output: Output,
    progress: &dyn Progress,
) -> Result<PolygonSummary> {
    if let Some(distance) = request.simplify {
        let expected = "none: chain codes follow the borders of cells, and simplified borders do not";
        return Err(Error::invalid("simplify", distance.to_string(), expected));
    }
    let mut request = request.clone();
    request.in_cells = true;
    if output.is_file() && request.directory.is_none() {
        // Temporary files of unfinished borders are created next to the output.
        request.directory = Some(PathBuf::from(spinney_base::io::directory_of(output.path())));
    }
    let level = request.level.unwrap_or(tree.depth());
    let mut writer = ChainWriter::create(output, tree, level, directions, progress)?;
    let summary = tree.polygons(&request, progress, &mut |region| writer.region(region))?;
    writer.finish().map(|()| summary)
}

/// Writer of a chain code file.
pub struct ChainWriter {
    output: Output,
    directions: ChainDirections,
    size: [u64; 2],
    value: ValueType,
    /// Buffered text.
    text: Vec<u8>,
    /// Steps in the current line.
    steps: usize,
    /// Number of regions and lines.
    count: u64,
}

impl ChainWriter {
    /// Starts a file for the cells of a level of a quadtree.
    ///
    /// # Errors
    /// If the tree is an octree or has several channels, there is no such level, or the output
    /// cannot be written.
    pub fn create(
        output: Output,
        tree: &Dataset,
        level: u8,
        directions: ChainDirections,
        progress: &dyn Progress,
    ) -> Result<ChainWriter> {
        let (header, metadata) = (tree.header(), tree.metadata());
        let value = header.form.value;
        if header.form.axes() != 2 || value.channels != 1 {
            let found = format!("chain codes of {}", header.form);
            return Err(Error::unsupported(
                tree.name(),
                found,
                "write them from a quadtree with one channel",
            ));
        }
        if level > tree.depth() {
            return Err(Error::invalid("level", level.to_string(), format!("0 to {}", tree.depth())));
        }
        let [width, height, _] = tree.extent_at(level).max;
        let mut text =
            format!("{MAGIC} {VERSION}\ndirections {}\nsize {width} {height}\n", directions.count());
        text += &format!("type {}\n", value.sample.name());
        if let Some(nodata) = metadata.nodata {
            text += &format!("nodata {nodata}\n");
        }
        text += &place_lines(&output, &metadata.frame.coarser(tree.depth() - level), progress);
        if let Some(palette) = &metadata.palette {
            let colour =
                |[red, green, blue, alpha]: &[u8; 4]| format!(" #{red:02x}{green:02x}{blue:02x}{alpha:02x}");
            text += &format!("palette{}\n", palette.colours.iter().map(colour).collect::<String>());
        }
        for (class, name) in &metadata.class_names {
            text += &format!("name {class} {}\n", serde_json::Value::from(name.as_str()));
        }
        let (size, text) = ([width, height], text.into_bytes());
        Ok(ChainWriter { output, directions, size, value, text, steps: 0, count: 0 })
    }

    /// Writes a region whose points are [in cells](PolygonRequest::in_cells).
    ///
    /// # Errors
    /// If a temporary file cannot be read, or the output cannot be written.
    pub fn region(&mut self, region: &ClassRegion<'_>) -> Result<()> {
        let mut part = 0;
        for (polygon, rings) in region.polygons().iter().enumerate() {
            for ring in 0..*rings {
                let chain = RingChain::new(region, part, ring == 0, self.directions)?;
                match (polygon, ring) {
                    (0, 0) => self.begin("region", Some(region.class()), chain.start)?,
                    (_, 0) => self.begin("part", None, chain.start)?,
                    _ => self.begin("hole", None, chain.start)?,
                }
                chain.each(&mut |code, count| self.steps(code, count))?;
                part += 1;
            }
        }
        self.count += 1;
        Ok(())
    }

    /// Writes a line, given by its vertices in cells, as a chain of the nearest cells. Each cell is
    /// one of the 8 neighbours of the cell before it. The cells get the class. Sections outside of
    /// the raster are omitted, so a line that leaves the raster and returns becomes several chains.
    /// Returns the number of chains.
    ///
    /// # Errors
    /// If chains have 4 directions, the tree cannot hold the class, or the output cannot be
    /// written.
    pub fn line(&mut self, class: Number, corners: &[[f64; 2]]) -> Result<usize> {
        if self.directions == ChainDirections::Four {
            return Err(Error::invalid(
                "number of directions",
                "4",
                "8, since chains of lines join cells in 8 directions",
            ));
        }
        if self.value.exact(&[class]).is_none() {
            let expected = format!("a class of type {}", self.value.sample.name());
            return Err(Error::invalid("class", class.to_string(), expected));
        }
        let chains = chains_of(corners, self.size);
        for chain in &chains {
            self.begin("line", Some(class), chain.start)?;
            chain.steps.iter().try_for_each(|(code, count)| self.steps(*code, *count))?;
            self.count += 1;
        }
        Ok(chains.len())
    }

    /// Ends the file and publishes it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(mut self) -> Result<()> {
        self.end_line();
        self.text.extend_from_slice(format!("end {}\n", self.count).as_bytes());
        self.flush(0)?;
        self.output.commit()
    }

    /// Starts a chain.
    fn begin(&mut self, word: &str, class: Option<Number>, [column, row]: [i64; 2]) -> Result<()> {
        self.end_line();
        let class = class.map_or(String::new(), |class| format!("{class} "));
        self.text.extend_from_slice(format!("{word} {class}{column} {row}\n").as_bytes());
        self.flush(PART)
    }

    /// Writes a code `count` times.
    fn steps(&mut self, code: u8, mut count: u64) -> Result<()> {
        while count > 0 {
            let here = count.min((LINE - self.steps) as u64);
            self.text.resize(self.text.len() + here as usize, b'0' + code);
            self.steps += here as usize;
            count -= here;
            if self.steps == LINE {
                self.end_line();
                self.flush(PART)?;
            }
        }
        Ok(())
    }

    fn end_line(&mut self) {
        if std::mem::take(&mut self.steps) > 0 {
            self.text.push(b'\n');
        }
    }

    /// Writes the buffered text if it exceeds `most` bytes.
    fn flush(&mut self, most: usize) -> Result<()> {
        if self.text.len() > most {
            self.output.write_all(&self.text).map_err(Error::io(self.output.path(), "write"))?;
            self.text.clear();
        }
        Ok(())
    }
}

/// Lines of the head that georeference the cells.
fn place_lines(output: &Output, frame: &Frame, progress: &dyn Progress) -> String {
    let mut text = String::new();
    if !frame.is_identity() {
        text += &format!("transform {}\n", frame.affine().map(|number| number.to_string()).join(" "));
    }
    if frame.pixel_is_point {
        text += "points\n";
    }
    if let Some(crs) = &frame.crs {
        // GeoTIFF keys have no text form that is a complete definition: convert them to WKT 2.
        let own = crs.definition();
        let definition = match Crs::parse(&own) {
            Ok(_) => Ok(own),
            Err(_) => crs.to_wkt2(),
        };
        match definition {
            Ok(definition) => {
                let definition: String =
                    definition.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
                text += &format!("crs {definition}\n");
            }
            Err(error) => {
                let remark = format!(
                    "does not store the coordinate system {crs}, which has no text definition: {error}"
                );
                progress.warn(output.path(), &remark);
            }
        }
    }
    text
}
