//! Chain codes as pictures, made row by row from the crossings of chains.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::crossings::{Change, Crossings, Sorted};
use super::parse::{self, Body, Head};
use crate::import::{Order, Pixels, Raster, RasterInfo, RasterOptions};
use spinney_base::space::Region;
use spinney_base::value::DataKind;
use spinney_base::{Error, Result};

/// A text of chains as a picture.
struct ChainPicture {
    path: PathBuf,
    info: RasterInfo,
    memory: u64,
    state: State,
}

/// How far a text was read.
enum State {
    /// Its head.
    Head(Box<(Head, Body)>),
    /// All of it; rows are made of this.
    Rows(Box<Sorted>),
    /// It could not be read.
    Failed,
}

/// Opens a text of chains, of which the head is read. Chains are read when the first row is asked for, with their crossings sorted in memory, or
/// in a temporary file in the system's folder for these.
///
/// # Errors
/// If it cannot be read, or breaks the rules.
pub(crate) fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let (head, body) = parse::open(path, &options.access)?;
    let size = match head.size {
        Some(size) => size,
        None => parse::measure(path, &options.access)?,
    };
    // (A few words may tell of any size.)
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
    Ok(Box::new(ChainPicture { path: path.into(), info, memory: options.memory, state }))
}

/// A region or line that has cells here.
#[derive(Default)]
struct Present {
    is_inside: bool,
    /// Chains whose cells these are.
    chains: u64,
    class: u64,
}

impl ChainPicture {
    /// The rows that are still to come.
    fn rows(&mut self) -> Result<&mut Sorted> {
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
                "the whole text",
                "an error before",
                "a text that can be read",
            )),
        }
    }
}

impl Raster for ChainPicture {
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
        // What is last in the text lies on top.
        let mut present: BTreeMap<u64, Present> = BTreeMap::new();
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
