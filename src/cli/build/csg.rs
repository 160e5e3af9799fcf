//! `spinney build` from CSG files: octrees, and exact models.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::raw::csg::{Csg, CsgExactOptions, CsgExactReport, CsgImport, ShellReport, import_exact_csg};
use spinney::{Output, Progress};

use super::rasters::RasterArgs;
use super::solids::{OF_CELLS, SolidArgs};
use super::{Common, Grid, Lines};

/// A CSG file that was read, and what to build from it.
pub(super) enum PrimitivesImport {
    Cells(Box<CsgImport>),
    Exact(Box<Csg>, CsgExactOptions, Lines),
}

impl PrimitivesImport {
    /// Reads the CSG file. It must be the only input.
    pub(super) fn plan(
        inputs: &[PathBuf],
        output: &Path,
        (rasters, solids, common): (&RasterArgs, &SolidArgs, &Common),
    ) -> Result<PrimitivesImport> {
        let [input] = inputs else {
            bail!(
                "got {} inputs, expected one .csg or .bpt file; consecutive solids in it are united",
                inputs.len()
            )
        };
        rasters.refuse(input)?;
        if common.grid == Some(Grid::Xyz) {
            bail!("--grid xyz: works only with rasters, {} is a model of a solid", input.display());
        }
        let csg = Csg::open(input)?;
        if !solids.brep {
            if let Some(option) = solids.of_exact_models() {
                bail!("{option}: works only with --brep, without --cells, --cell and --grid");
            }
            common.given.check("cells of primitives", &OF_CELLS)?;
            let options = solids.options(csg.unit(), output, common)?;
            return Ok(PrimitivesImport::Cells(Box::new(CsgImport::plan(csg, &options)?)));
        }
        if let Some(option) = solids.of_meshes() {
            bail!("{option}: works only with models that have faces; {} has primitives", input.display());
        }
        let fitting = ["--brep", "--deviation", "--snap", "--unit", "--crs", "--codec"];
        common.given.check("an exact model of primitives", &fitting)?;
        let mut options = CsgExactOptions::new();
        options.deviation = solids.deviation;
        options.snap = solids.snap;
        options.unit.clone_from(&solids.unit);
        options.crs.clone_from(&common.crs);
        options.codec = common.packing.choice().codec;
        options.memory = common.memory.bytes;
        let count = csg.primitives();
        let plural = if count == 1 { "" } else { "s" };
        let description = vec![("input", format!("{} ({count} primitive{plural})", input.display()))];
        Ok(PrimitivesImport::Exact(Box::new(csg), options, description))
    }

    pub(super) fn description(&self) -> &[(&'static str, String)] {
        match self {
            PrimitivesImport::Cells(import) => import.description(),
            PrimitivesImport::Exact(.., description) => description,
        }
    }

    /// Returns the unit of the build's progress, in the plural.
    pub(super) fn unit(&self) -> &'static str {
        match self {
            PrimitivesImport::Cells(_) => "cells",
            PrimitivesImport::Exact(..) => "primitives",
        }
    }

    /// Builds the file. Returns lines about it.
    pub(super) fn build(self, output: Output, progress: &dyn Progress) -> Result<Lines> {
        match self {
            PrimitivesImport::Cells(import) => {
                let is_empty = import.build(output, progress)? == 0;
                let text = "the tree is empty: the solid is empty, or thinner than a cell";
                Ok(is_empty.then(|| ("warning", text.into())).into_iter().collect())
            }
            PrimitivesImport::Exact(csg, options, _) => Ok(lines(
                &import_exact_csg(&csg, &options, output, progress)?,
                options.unit.or(csg.unit().map(Into::into)),
            )),
        }
    }
}

/// Returns lines about an exact model.
fn lines(report: &CsgExactReport, unit: Option<String>) -> Lines {
    let unit = unit.map_or(String::new(), |unit| format!(" {unit}"));
    let CsgExactReport { curved, deviation, facets, shells, displacement, model, ends, .. } = report;
    let mut lines: Lines = ends.iter().map(|ends| ("ends", ends.clone())).collect();
    lines.push(match curved {
        0 => ("facets", format!("{facets}; all primitives are planar, and exact except for rounded vertices")),
        _ => (
            "facets",
            format!("{facets}, with vertices on the surfaces; those of the {curved} curved primitives deviate by at most {deviation}{unit} (--deviation)"),
        ),
    });
    for shell in shells {
        let ShellReport { name, patches, volume, facet_volume, .. } = shell;
        let cubic = if unit.is_empty() { String::new() } else { format!("{unit}3") };
        let text = format!(
            "{volume}{cubic} in {name} ({patches} patches), by the integral of their polynomials; {facet_volume}{cubic} in their facets"
        );
        lines.push(("volume", text));
    }
    let moved = match *displacement {
        0.0 => "no vertex was moved".into(),
        most => format!("vertices moved by at most {most:e}{unit}"),
    };
    let grid = &model.grid;
    lines.push(("grid", format!("units of {}{unit}, {} bits; {moved}", grid.width(), grid.bits)));
    let nothing = if model.after == 0 { ": the solid is empty" } else { "" };
    lines.push(("faces", format!("{} of the solid{nothing}", model.after)));
    let nodes = model.built.nodes.named();
    let nodes: Vec<String> =
        nodes.iter().filter(|(_, count)| *count > 0).map(|(name, count)| format!("{count} {name}")).collect();
    lines.push(("nodes", format!("{}: {}", model.built.nodes.total(), nodes.join(", "))));
    lines
}
