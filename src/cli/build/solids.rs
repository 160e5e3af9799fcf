//! Options of `spinney build` for models of solids, and lines about a solid that was built.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use spinney::FileAccess;
use spinney::import::mesh::{Resolution, SolidImport, SolidOptions};
use spinney::query::EdgeRule;
use spinney::raw::brep::InsideRule;
use spinney::raw::geometry::Stages;
use spinney::raw::import::mesh::{InsideTest, SolidReport};
use spinney::raw::shards::JobSpec;
use spinney::raw::space::Up;

use super::super::args::{UNITS, check_output};
use super::super::open;
use super::{Common, Grid, Lines, RasterArgs, grid_of};

/// Options for models only.
#[derive(clap::Args, Debug)]
pub(in crate::cli) struct SolidArgs {
    /// Cells along the longest side of the model or of all features [default: 256 of models]
    #[arg(long, value_name = "N", conflicts_with_all = ["depth", "grid"])]
    cells: Option<u64>,
    /// Width of a cell, such as 0.5 or 0.5mm; trees with the same width are aligned
    #[arg(long, value_name = "WIDTH", conflicts_with_all = ["cells", "depth", "grid"], value_parser = parse_width)]
    cell: Option<Width>,
    /// Only the cells that the surface cuts, not those that it encloses; a face exactly between
    /// cells cuts those on its inner side
    #[arg(long)]
    shell: bool,
    /// Cells at the edge, which the surface or a polygon's side cuts: centre (those whose centre is
    /// inside), touch (all of them) or area (each by its share inside; for features the value with
    /// the largest share) [default: centre]
    #[arg(long, value_name = "RULE")]
    edge: Option<EdgeRule>,
    /// Attribute of the cells: occupancy (255 is full), colour, or part (the number of an object,
    /// group or material) [default: occupancy]; for points, names of attributes to keep, as in
    /// intensity,classification [default: all]
    #[arg(long, value_name = "NAME,...")]
    pub(super) attribute: Option<String>,
    /// Axis that points up in the model, y or z; y is rotated to z [default: z];
    /// without effect on glTF, which always has y up
    #[arg(long, value_name = "AXIS")]
    pub(super) up: Option<Up>,
    /// Unit of the model's coordinates, if the file has none: mm, cm, m, km, in or ft
    #[arg(long, value_parser = UNITS)]
    pub(super) unit: Option<String>,
    /// Print statistics: how the surface was read and what it encloses
    #[arg(long)]
    pub(super) stats: bool,
    /// Keep the faces unchanged, on a fine grid: an exact model instead of cells
    #[arg(long, conflicts_with_all = ["cells", "cell", "grid", "depth", "shell", "edge", "attribute", "share", "max_error"])]
    pub(super) brep: bool,
    /// Maximum number of faces in a leaf, whatever their planes have in common; 0 splits nodes
    /// until their faces have a common point, as in the literature [default: 12]. For points and
    /// lines: points [default: 50000] or line segments [default: 1024] of a leaf
    #[arg(long, value_name = "N")]
    pub(super) leaf_size: Option<usize>,
    /// Width of the grid units that vertices are moved to, such as 0.001 [default: the file's own
    /// grid, or the smallest power of two that leaves about 2^24 units along the longest side]
    #[arg(long, value_name = "WIDTH", requires = "brep")]
    pub(super) snap: Option<f64>,
    /// Maximum distance of facets from curved surfaces of primitives (.csg, .bpt), such as 0.01
    /// [default: a thousandth of the longest side]
    #[arg(long, value_name = "DISTANCE", requires = "brep")]
    pub(super) deviation: Option<f64>,
    /// Levels of detail: add coarser surfaces with bounds of their error
    #[arg(long, requires = "brep")]
    pub(super) levels: bool,
    /// Close an open surface with triangles over its boundaries
    #[arg(long, requires = "brep")]
    pub(super) close: bool,
    /// Repair a surface that intersects or overlaps itself, or is inside out: bodies that are
    /// inside out are reversed, and faces that bound nothing are removed. Its faces are held in
    /// memory
    #[arg(long, requires = "brep")]
    pub(super) repair: bool,
    /// Inside rule of a repair: nonzero (points with a nonzero winding number, as in trees of
    /// cells), positive (points with a positive winding number, so that reversed bodies within
    /// bodies are holes) or odd (points with an odd winding number) [default: nonzero]
    #[arg(long, value_name = "RULE", requires = "repair")]
    pub(super) inside: Option<InsideRule>,
    /// Leave out objects (city objects, groups of files that have objects, files) that are not
    /// valid bodies, and report which and why: open ones without --close, and ones that intersect
    /// themselves or are inside out without --repair
    #[arg(long, requires = "brep")]
    pub(super) skip_bad: bool,
}

/// A width, with its unit if one was given.
#[derive(Clone, Debug, PartialEq)]
struct Width(f64, Option<String>);

/// Parses a width.
fn parse_width(text: &str) -> Result<Width, String> {
    let end = text.find(|c: char| c.is_ascii_alphabetic() && c != 'e').unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let number: f64 = number.trim().parse().map_err(|_| "expected a width, such as 0.5 or 0.5mm")?;
    if !unit.is_empty() && metres(unit).is_none() {
        return Err("expected the unit mm, cm, m, km, in or ft".into());
    }
    Ok(Width(number, (!unit.is_empty()).then(|| unit.to_string())))
}

/// Returns the length of a unit in metres.
fn metres(unit: &str) -> Option<f64> {
    let units = [("mm", 0.001), ("cm", 0.01), ("m", 1.0), ("km", 1000.0), ("in", 0.0254), ("ft", 0.3048)];
    units.into_iter().find(|(name, _)| *name == unit).map(|(_, metres)| metres)
}

/// Options for the cells of a solid, from any kind of input.
pub(super) const OF_CELLS: [&str; 14] = [
    "--cells",
    "--cell",
    "--grid",
    "--depth",
    "--edge",
    "--attribute",
    "--shell",
    "--up",
    "--unit",
    "--crs",
    "--share",
    "--time",
    "--codec",
    "--max-error",
];

impl SolidArgs {
    /// Fails if one of these options was given for a raster or tree, which has its own cells.
    pub(in crate::cli) fn refuse(&self, input: &Path) -> Result<()> {
        let given = [
            ("--cells", self.cells.is_some()),
            ("--cell", self.cell.is_some()),
            ("--shell", self.shell),
            ("--edge", self.edge.is_some()),
            ("--attribute", self.attribute.is_some()),
            ("--leaf-size", self.leaf_size.is_some()),
            ("--up", self.up.is_some()),
            ("--unit", self.unit.is_some()),
            ("--stats", self.stats),
            // (The other options require it.)
            ("--brep", self.brep),
        ];
        let Some((option, _)) = given.into_iter().find(|(_, given)| *given) else { return Ok(()) };
        let advice = match option {
            "--cells" | "--cell" => {
                "; the input has its own cells: for larger or smaller ones, use scale= of `spinney transform` on the tree, or for rasters --grid TREE"
            }
            _ => "",
        };
        bail!(
            "{}: is not a model (PLY, OBJ, STL, OFF, glTF, CityJSON, CSG){}, which {option} needs{advice}",
            input.display(),
            if ["--cells", "--cell", "--edge"].contains(&option) { " or feature file" } else { "" }
        )
    }

    /// Returns the options that are for features, too: cells along the longer side, their width,
    /// and the rule for edges.
    ///
    /// # Errors
    /// If the width has a unit.
    pub(super) fn of_features(&self) -> Result<(Option<u64>, Option<f64>, Option<EdgeRule>)> {
        let cell = match &self.cell {
            Some(Width(_, Some(unit))) => {
                bail!(
                    "--cell: got a width in {unit}, expected units of the features' coordinates; leave out {unit}"
                )
            }
            Some(Width(width, None)) => Some(*width),
            None => None,
        };
        Ok((self.cells, cell, self.edge))
    }

    /// Returns the first given option that only exact models have.
    pub(super) fn of_exact_models(&self) -> Option<&'static str> {
        let given = [
            ("--leaf-size", self.leaf_size.is_some()),
            ("--snap", self.snap.is_some()),
            ("--deviation", self.deviation.is_some()),
            ("--close", self.close),
            ("--repair", self.repair),
            ("--skip-bad", self.skip_bad),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Returns the first given option for the faces of models, which primitives reject.
    pub(super) fn of_meshes(&self) -> Option<&'static str> {
        let given = [
            ("--leaf-size", self.leaf_size.is_some()),
            ("--close", self.close),
            ("--repair", self.repair),
            ("--skip-bad", self.skip_bad),
            ("--up", self.up.is_some()),
            ("--stats", self.stats),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Opens models, and plans one solid of them.
    pub(super) fn plan(&self, inputs: &[PathBuf], output: &Path, common: &Common) -> Result<SolidImport> {
        let models = spinney::raw::import::mesh::open_all_with(inputs, common.memory.bytes, &common.access)?;
        let unit = models.iter().find_map(|model| model.info().unit.clone());
        Ok(spinney::import::mesh::plan_models(models, &self.options(unit.as_deref(), output, common)?)?)
    }

    /// Returns the job of a sharded build of a solid.
    pub(in crate::cli) fn job(
        &self,
        inputs: Vec<PathBuf>,
        job: &Path,
        rasters: &RasterArgs,
        common: &Common,
    ) -> Result<JobSpec> {
        if let Some(input) = inputs.first() {
            rasters.refuse(input)?;
        }
        let given = [("--brep", self.brep), ("--stats", self.stats)];
        let given = given.into_iter().find(|(_, is_given)| *is_given).map(|(name, _)| name);
        if let Some(option) = given.or(self.of_exact_models()) {
            bail!("{option}: works only with `spinney build`; shards make cells of closed models");
        }
        let models = spinney::raw::import::mesh::open_all_with(&inputs, common.memory.bytes, &common.access)?;
        let unit = models.iter().find_map(|model| model.info().unit.clone());
        let options = self.options(unit.as_deref(), job, common)?;
        Ok(JobSpec::Solid { inputs, options })
    }

    /// Returns the options for a solid. `unit` is the models' own unit.
    pub(super) fn options(&self, unit: Option<&str>, output: &Path, common: &Common) -> Result<SolidOptions> {
        let Common { depth, crs, memory, share, time, grid, .. } = common;
        let like = match grid {
            Some(Grid::Like(path)) => Some(path.as_path()),
            _ => None,
        };
        check_output(like, output)?;
        let mut options = SolidOptions::new();
        options.resolution = self.resolution(*depth, (like, &common.access), unit)?;
        options.edge = self.edge.unwrap_or_default();
        options.attribute = self.attribute.as_deref().map(str::parse).transpose()?.unwrap_or_default();
        options.shell = self.shell;
        options.up = self.up.unwrap_or_default();
        options.unit = self.unit.clone().or(unit.map(String::from));
        options.crs = crs.clone();
        options.packing = common.packing.choice();
        options.memory = memory.bytes;
        (options.share, options.time) = (*share, *time);
        if self.shell && self.edge.is_some() {
            bail!("--edge: has no effect with --shell, which keeps all cells that the surface cuts");
        }
        Ok(options)
    }

    /// Returns the chosen resolution. `depth` is that of the tree, and `unit` the models' own unit.
    fn resolution(
        &self,
        depth: Option<u8>,
        (like, access): (Option<&Path>, &FileAccess),
        unit: Option<&str>,
    ) -> Result<Resolution> {
        if let Some(Width(width, given)) = &self.cell {
            let Some(given) = given else { return Ok(Resolution::Cell(*width)) };
            let unit = self.unit.as_deref().or(unit);
            let unit = unit.context("--cell: the model's unit is unknown; set it with --unit")?;
            let of = |unit: &str| metres(unit).with_context(|| format!("unknown unit {unit}; use --unit"));
            return Ok(Resolution::Cell(width * of(given)? / of(unit)?));
        }
        if let Some(path) = like {
            let tree = open(path, access)?;
            return Ok(Resolution::Like(grid_of(&tree, 3, path)?.frame, tree.depth()));
        }
        Ok(depth.map_or(Resolution::Cells(self.cells.unwrap_or(256)), Resolution::Depth))
    }

    /// Returns a warning about a closed solid that is so thin that its cells are far from its
    /// volume.
    fn thinness(&self, report: &SolidReport) -> Option<String> {
        // (Plates are this thick; rods and balls are thicker.)
        let volume = report.volume.abs();
        let thickness = 2.0 * volume / report.area;
        let is_thin = report.inside == InsideTest::Closed && thickness < 3.0 * report.cell;
        if !is_thin || (report.filled - volume).abs() <= MAX_DEVIATION * volume {
            return None;
        }
        let [filled, volume, thick, cell] =
            [report.filled, volume, thickness, report.cell].map(|number| significant(number, 4));
        let small = format!("--cell {} makes cells small enough", significant(thickness / 4.0, 1));
        let has_fullness =
            report.cells == 0 || self.attribute.as_deref().is_none_or(|name| name == "occupancy");
        let advice = match has_fullness && self.edge != Some(EdgeRule::Area) {
            true => format!("--edge area gives each cell its share; {small}"),
            false => small,
        };
        Some(format!(
            "the cells have a volume of {filled}, the surface encloses {volume}: the solid is about {thick} thick, \
             a cell {cell} wide; {advice}"
        ))
    }

    /// Returns lines about a solid that was built.
    pub(super) fn lines(&self, report: &SolidReport) -> Lines {
        let mut lines = vec![("surface", report.inside.text().to_string())];
        if let Some(text) = self.thinness(report) {
            lines.push(("warning", text));
        } else if report.cells == 0 {
            let text = match report.inside {
                InsideTest::Surface => {
                    "the tree is empty: all faces lie in walls between cells, which belong to no cell; choose \
                     another --cell"
                }
                _ => {
                    "the tree is empty: the surface encloses no cell, as it is open, flat, doubled with \
                     opposite orientations or thinner than a cell; --edge area gives each cell its share of \
                     a thin solid, --cell sets smaller cells, and --shell builds the cells that it cuts"
                }
            };
            lines.push(("warning", text.into()));
        }
        if report.open_triangles > 0 && report.open_triangles < report.triangles {
            let (open, all) = (report.open_triangles, report.triangles);
            lines.push((
                "open",
                format!("{open} of {all} triangles are of open objects; the others are closed"),
            ));
        }
        if report.undecided > 0 {
            lines.push(("undecided", format!("{} cells in its holes, by a guess", report.undecided)));
        }
        if report.collapsed > 0 {
            let (collapsed, all) = (report.collapsed, report.faces);
            lines.push((
                "collapsed",
                format!("{collapsed} of {all} faces are points or lines on the cells' grid, and are ignored"),
            ));
        }
        if report.duplicates > 0 {
            lines.push(("doubled", format!("{} triangles, which count once", report.duplicates)));
        }
        if self.stats {
            let (faces, degenerate, triangles) = (report.faces, report.degenerate, report.triangles);
            let text = format!("{faces} read, {triangles} triangles; {degenerate} without area left out");
            lines.push(("faces", text));
            let unit = report.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
            lines.push(("moved", format!("vertices by at most {:e}{unit}", report.displacement)));
            lines.extend(stage_lines(&report.stages));
        }
        lines
    }
}

/// Returns lines about the filter stages of the tests between faces and octants.
pub(super) fn stage_lines(stages: &Stages) -> Lines {
    let line = |(name, missed, cut)| {
        (name, format!("decided {missed} times that an octant is not cut, {cut} times that it is"))
    };
    stages.named().map(line).collect()
}

/// Maximum deviation of the volume of cells from that of their surface, as a fraction, without a
/// warning.
const MAX_DEVIATION: f64 = 0.1;

/// Rounds a number to some significant digits.
fn significant(number: f64, digits: i32) -> f64 {
    if number == 0.0 || !number.is_finite() {
        return number;
    }
    let text = format!("{number:.*e}", (digits - 1) as usize);
    text.parse().unwrap_or(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_read() {
        assert_eq!(parse_width("0.5"), Ok(Width(0.5, None)));
        assert_eq!(parse_width("0.5mm"), Ok(Width(0.5, Some("mm".into()))));
        assert_eq!(parse_width("1e-3m"), Ok(Width(0.001, Some("m".into()))));
        for text in ["", "mm", "5 yards", "1,5"] {
            assert!(parse_width(text).is_err(), "{text}");
        }
    }
}
