//! Export of a box of an octree as a three-dimensional array, streamed in slabs.

use std::io::Write;

use super::image::{Format, array_header};
use super::volume::nrrd_head;
use super::window::{DEFAULT_MEMORY, VoidCells};
use spinney_base::io::Output;
use spinney_base::space::Bounds;
use spinney_base::value::Number;
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;

/// A box of an octree and its level of detail.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ArrayRequest {
    /// Box in cells of `level`.
    pub bounds: Bounds,
    /// Level of the cells.
    pub level: u8,
    /// The number for VOID cells; an error if it lies within the range of the values. The default
    /// is that of images, see [`void_number`](super::void_number).
    pub nodata: Option<Number>,
    /// Memory budget in bytes; one row of cells must fit.
    pub memory: u64,
}

impl ArrayRequest {
    /// A box in cells of a level, with a memory budget of 64 MiB.
    pub fn new(bounds: Bounds, level: u8) -> ArrayRequest {
        ArrayRequest { bounds, level, nodata: None, memory: DEFAULT_MEMORY }
    }
}

/// Writes a box of an octree as NPY (an array of shape z, y, x), as NRRD (with its frame, units and
/// tags) or as raw samples. Raw samples are ordered x fastest, then y, then z. `import::volume`
/// reads such NPY and NRRD files.
///
/// # Errors
/// If the tree is a quadtree or has no such level, the box is empty or exceeds the tree's space,
/// one row exceeds the memory budget, the format is any other, the tree is corrupt, or on
/// cancellation.
pub fn export_array(
    tree: &Dataset,
    request: &ArrayRequest,
    mut output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    let ArrayRequest { bounds, level, nodata, memory } = *request;
    let header = tree.header();
    if header.form.axes() != 3 {
        return Err(Error::invalid("tree", "a quadtree", "an octree (boxes have three dimensions)"));
    }
    if level > tree.depth() {
        return Err(Error::invalid("level", level.to_string(), format!("0 to {}", tree.depth())));
    }
    let inside = tree.extent_at(level);
    if bounds.is_empty() || !inside.contains(&bounds) {
        let ([x, y, z], [w, h, d], [a, b, c]) = (bounds.min, bounds.size(), inside.max);
        let found = format!("{w} x {h} x {d} cells from {x},{y},{z}");
        return Err(Error::invalid(
            "box",
            found,
            format!("a box within the {a} x {b} x {c} cells of level {level}"),
        ));
    }
    let [width, height, depth] = bounds.size();
    // One byte per cell in addition to the value: its validity flag.
    let row = width * (header.form.value.size() as u64 + 1);
    if row > memory {
        return Err(Error::TooLarge {
            path: tree.name().to_path_buf(),
            what: format!("a row of {width} cells"),
            needed: row,
            limit: memory,
            advice: "request a smaller box or a coarser level".into(),
        });
    }
    let shift = tree.depth() - level;
    let max = std::array::from_fn(|axis| (bounds.max[axis] << shift).min(header.extent[axis]));
    let cells = Bounds { min: bounds.min.map(|cell| cell << shift), max };
    let void = VoidCells::of(std::slice::from_ref(tree), cells, nodata)?;
    void.check((output.path(), header.form.value.sample), format, progress)?;
    let fill = void.fill.unwrap_or_default();
    match format {
        Format::Npy => {
            let header = array_header(header.form.value, &[depth, height, width]);
            output.write_all(&header).map_err(Error::io(output.path(), "write"))?;
        }
        Format::Nrrd => {
            let metadata = tree.metadata();
            let frame = metadata.frame.coarser(tree.depth() - level);
            let frame = frame.shifted(bounds.min.map(|cell| cell as f64));
            let head = nrrd_head(header.form.value, [width, height, depth], &frame, metadata);
            output.write_all(head.as_bytes()).map_err(Error::io(output.path(), "write"))?;
        }
        Format::Raw => {}
        _ => {
            return Err(Error::unsupported(
                output.path(),
                "a box of cells in an image file",
                "write .npy, .nrrd or .raw",
            ));
        }
    }
    // Read whole planes at a time, or rows of one plane.
    let rows = (memory / row).clamp(1, height);
    let planes = if rows == height { (memory / (row * height)).clamp(1, 64) } else { 1 };
    for z in (bounds.min[2]..bounds.max[2]).step_by(planes as usize) {
        for y in (bounds.min[1]..bounds.max[1]).step_by(rows as usize) {
            progress.check()?;
            let part = Bounds {
                min: [bounds.min[0], y, z],
                max: [bounds.max[0], bounds.max[1].min(y + rows), bounds.max[2].min(z + planes)],
            };
            let mut bytes = vec![0; part.volume() as usize * header.form.value.size()];
            tree.window(level, &part, fill, &mut bytes, None)?;
            output.write_all(&bytes).map_err(Error::io(output.path(), "write"))?;
            progress.advance(part.volume(), bounds.volume());
        }
    }
    tree.check_unchanged()?;
    output.commit()
}
