//! Chain codes as rasters, filled row by row from the crossings of the chains.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::crossings::{Change, Crossings, SortedCrossings};
use super::parse::{self, Body, Head};
use crate::import::{Order, Pixels, Raster, RasterInfo, RasterOptions};
use spinney_base::space::Region;
use spinney_base::value::DataKind;
use spinney_base::{Error, Result};

/// A chain code file as a raster.
struct ChainRaster {
    path: PathBuf,
    info: RasterInfo,
    memory: u64,
    state: State,
}

/// Progress of reading the file.
enum State {
    /// The head was read.
    Head(Box<(Head, Body)>),
    /// All chains were read; rows are made from this.
    Rows(Box<SortedCrossings>),
    /// Reading failed.
    Failed,
}

/// Opens a chain code file and reads its head. The chains are read when the first row is requested.
/// Their crossings are sorted in memory, or in a temporary file in the system's directory for
/// these.
///
/// # Errors
/// If the file cannot be read, or violates the grammar.
pub(crate) fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let (head, body) = parse::open(path, &options.access)?;
    let size = match head.size {
        Some(size) => size,
        None => parse::measure(path, &options.access)?,
    };
    // A short file can declare any size.
    let row = size[0].saturating_mul(head.sample.size() as u64 + 1);
    options.check_memory(path, &format!("a row of {} cells", size[0]), row)?;
    let info = RasterInfo {
        frame: head.frame.clone(),
        nodata: head.nodata,
        palette: head.palette.clone(),
        class_names: head.names.clone(),
        kind: Some(DataKind::Categorical),
        layout: format!("chain code of {} directions", head.directions.count()),
        order: Order::Bands,
        ..RasterInfo::plain(size, head.sample, 1)
    };
    let state = State::Head(Box::new((Head { size: Some(size), ..head }, body)));
    Ok(Box::new(ChainRaster { path: path.into(), info, memory: options.memory, state }))
}

/// A region or line that covers the current cell.
#[derive(Default)]
struct ActiveOwner {
    is_inside: bool,
    /// Number of its chains that pass through the current cell.
    chains: u64,
    class: u64,
}

impl ChainRaster {
    /// Returns the remaining rows; reads the chains first if necessary.
    fn rows(&mut self) -> Result<&mut SortedCrossings> {
        if let State::Head(_) = &self.state
            && let State::Head(read) = std::mem::replace(&mut self.state, State::Failed)
        {
            let (head, body) = *read;
            let mut crossings = Crossings::new(&std::env::temp_dir(), self.memory / 2);
            body.each(&head, &mut |crossing| crossings.push(crossing))?;
            self.state = State::Rows(Box::new(crossings.sorted()?));
        }
        match &mut self.state {
            State::Rows(rows) => Ok(rows),
            _ => Err(Error::corrupt(
                &self.path,
                "the whole file",
                "an error while an earlier row was read",
                "valid chain codes",
            )),
        }
    }
}

impl Raster for ChainRaster {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let (size, width) = (self.info.sample.size(), region.width as usize);
        let rows = self.rows()?;
        let mut valid = vec![false; region.area() as usize];
        pixels.bytes.clear();
        pixels.bytes.resize(valid.len() * size, 0);
        // The last region or line of the file is on top.
        let mut present: BTreeMap<u64, ActiveOwner> = BTreeMap::new();
        let lines = pixels.bytes.chunks_exact_mut(width * size).zip(valid.chunks_exact_mut(width));
        for (row, (bytes, valid)) in (region.y as u32..).zip(lines) {
            present.clear();
            let mut at = 0;
            while let Some(crossing) = rows.next_in(row)? {
                let column = crossing.column as usize;
                if column > at {
                    if let Some(top) = present.values().next_back() {
                        let value = &top.class.to_le_bytes()[..size];
                        bytes[at * size..column * size]
                            .chunks_exact_mut(size)
                            .for_each(|cell| cell.copy_from_slice(value));
                        valid[at..column].fill(true);
                    }
                    at = column;
                }
                let here = present.entry(crossing.owner).or_default();
                here.class = crossing.class;
                match crossing.change {
                    Change::Cross => here.is_inside = !here.is_inside,
                    Change::Begin => here.chains += 1,
                    Change::End => here.chains -= 1,
                }
                if !here.is_inside && here.chains == 0 {
                    present.remove(&crossing.owner);
                }
            }
        }
        pixels.valid = valid.contains(&false).then_some(valid);
        Ok(())
    }
}
