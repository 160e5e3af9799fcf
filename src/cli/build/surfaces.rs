//! `spinney build` of triangulated surfaces from points.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::export::MeshFormat;
use spinney::import::feature::FeatureOptions;
use spinney::raw::export::mesh::{SurfaceMesh, export_triangles};
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::space::PolygonParts;
use spinney::raw::store::Packing;
use spinney::raw::tin::{
    BoreholeAttributes, BoreholeReport, Duplicates, LayerInput, LayerOptions, LayerSurface, Smoothing,
    SurfaceFiles, SurfaceInput, SurfacePoints, SurfaceRaster, SurfaceReport, Tin, build_layers,
    order_surfaces, read_surfaces, triangulate, write_surface,
};
use spinney::{Frame, Metadata, Output, Progress};

use super::super::args::number;
use super::features::FeatureArgs;
use super::rasters::RasterArgs;
use super::solids::SolidArgs;
use super::{Common, Lines};

/// Options for surfaces only.
#[derive(clap::Args, Debug)]
pub(super) struct SurfaceArgs {
    /// Triangulated surface (TIN) of points whose heights are an attribute, as a raster (--cell) or
    /// its triangles (if the output is .ply, .obj or .off); with --brep the layers between the
    /// surfaces of several attributes, from the top down
    #[arg(long, value_name = "ATTRIBUTE,...", value_delimiter = ',')]
    pub(super) tin: Option<Vec<String>>,
    /// Lines that become edges of the triangles, such as faults and ridges: features, with an
    /// attribute z if they have their own heights
    #[arg(long, value_name = "FILE", requires = "tin")]
    breaklines: Option<PathBuf>,
    /// Polygons that limit the surface: features [default: the convex hull of the points]
    #[arg(long, value_name = "FILE", requires = "tin")]
    outline: Option<PathBuf>,
    /// Attribute with the name of a borehole's layer, one of those of --tin: there is a row for
    /// each borehole and layer
    #[arg(long, value_name = "ATTRIBUTE", requires = "tin", requires = "depth_attribute")]
    layer_attribute: Option<String>,
    /// Attribute with the depth of a borehole's layer below the mouth, whose height is attribute z
    /// or the z of the point; without these, surfaces have negative depths as heights
    #[arg(long, value_name = "ATTRIBUTE", requires = "tin", requires = "layer_attribute")]
    depth_attribute: Option<String>,
    /// Smooth surfaces: number of passes, in each of which heights move half of the way to the mean
    /// of their neighbours, except those on breaklines and at the border (Laplacian smoothing)
    #[arg(long, value_name = "PASSES", requires = "tin", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    smooth: Option<u32>,
    /// Maximum distance by which --smooth moves a height [default: no limit]
    #[arg(long, value_name = "DISTANCE", requires = "smooth", value_parser = number::<f64>)]
    smooth_distance: Option<f64>,
    /// Keep the heights of points: --smooth divides triangles into four, and moves the midpoints of
    /// edges only
    #[arg(long, requires = "smooth")]
    keep_points: bool,
}

/// Points that were read, and what to build from them.
pub(super) struct SurfaceImport {
    points: SurfacePoints,
    names: Vec<String>,
    target: Target,
    smoothing: Option<Smoothing>,
    provenance: String,
    description: Lines,
}

enum Target {
    /// A raster: cell width, memory limit in bytes, packing.
    Raster(f64, u64, Packing),
    Layers(LayerOptions),
    /// Triangles of the surfaces.
    Mesh(MeshFormat),
}

impl SurfaceArgs {
    /// Returns the format of an output that is a mesh of triangles.
    pub(super) fn mesh_format(output: &Path) -> Option<MeshFormat> {
        MeshFormat::of(output).filter(|format| *format != MeshFormat::CityJson)
    }

    fn smoothing(&self) -> Option<Smoothing> {
        let mut smoothing = Smoothing::of_passes(self.smooth?);
        smoothing.max_distance = self.smooth_distance.unwrap_or(smoothing.max_distance);
        smoothing.keeps_points = self.keep_points;
        Some(smoothing)
    }

    /// Reads the points.
    pub(super) fn plan(
        &self,
        inputs: &[PathBuf],
        output: &Path,
        (common, rasters, solids, features): (&Common, &RasterArgs, &SolidArgs, &FeatureArgs),
    ) -> Result<SurfaceImport> {
        let [input] = inputs else {
            bail!("--tin: got {} inputs, expected one file of points", inputs.len())
        };
        if !is_feature_file(input) {
            bail!("--tin: works only with point features, {} has none", input.display());
        }
        let of_all = [
            "--tin",
            "--breaklines",
            "--outline",
            "--layer-attribute",
            "--depth-attribute",
            "--smooth",
            "--smooth-distance",
            "--keep-points",
            "--crs",
            "--where",
            "--layer",
        ];
        let names = self.tin.clone().unwrap_or_default();
        let mesh = SurfaceArgs::mesh_format(output);
        let (what, of_one): (_, &[&str]) = match (mesh, solids.brep) {
            (Some(_), _) => ("the triangles of a surface", &[]),
            (None, false) => ("the raster of a surface", &["--cell", "--max-error", "--codec"]),
            (None, true) => ("layers between surfaces", &["--brep", "--snap", "--unit", "--codec"]),
        };
        common.given.check(what, &[&of_all[..], of_one].concat())?;
        let packing = common.packing.choice();
        let provenance = format!("{}: triangulated surface of {}", input.display(), names.join(", "));
        let smoothing = self.smoothing();
        let target = match (mesh, solids.brep) {
            (Some(format), _) => Target::Mesh(format),
            (None, false) => {
                let (None, Some(cell), None) = solids.of_features()? else {
                    bail!("--tin: needs --cell, the width of the raster's cells, or --brep for layers");
                };
                if names.len() != 1 {
                    bail!(
                        "--tin: got {} attributes, expected one for a raster; --brep makes the layers between several",
                        names.len()
                    );
                }
                Target::Raster(cell, common.memory.bytes, packing)
            }
            (None, true) => {
                if names.len() < 2 {
                    bail!(
                        "--tin: got one attribute, expected at least two for layers, from the top down, as in --tin top,base; \
                         for the triangles of one surface, which bound no body, write a mesh: -o {}.ply",
                        names.join(",")
                    );
                }
                let mut options = LayerOptions::new();
                options.snap = solids.snap;
                options.smoothing = smoothing;
                options.unit.clone_from(&solids.unit);
                (options.codec, options.memory) = (packing.codec, common.memory.bytes);
                options.provenance.clone_from(&provenance);
                Target::Layers(options)
            }
        };
        let boreholes = self.layer_attribute.clone().zip(self.depth_attribute.clone());
        let files = SurfaceFiles {
            points: input.clone(),
            heights: names.clone(),
            boreholes: boreholes.map(|(layer, depth)| BoreholeAttributes { layer, depth }),
            options: FeatureOptions {
                layer: rasters.layer.clone(),
                filter: features.filter.clone().unwrap_or_default(),
                check_degrees: common.crs.is_none(),
                ..FeatureOptions::default()
            },
            breaklines: self.breaklines.clone(),
            outline: self.outline.clone(),
        };
        let mut points = read_surfaces(&files)?;
        if common.crs.is_some() {
            points.crs.clone_from(&common.crs);
            points.crs_file = None;
        }
        let mut description = vec![("input", input.display().to_string())];
        description.extend(points.boreholes.as_ref().map(borehole_lines).unwrap_or_default());
        let missing = if points.boreholes.is_some() { "depth" } else { "height" };
        for ((name, found), without) in names.iter().zip(&points.points).zip(&points.without) {
            let none = if *without > 0 { format!(", {without} without a {missing}") } else { String::new() };
            description.push(("heights", format!("{name}: {} points{none}", found.len())));
        }
        Ok(SurfaceImport { points, names, target, smoothing, provenance, description })
    }
}

/// Returns lines about boreholes in long form.
fn borehole_lines(report: &BoreholeReport) -> Lines {
    let mouths = match report.has_mouths {
        true => "heights are those of mouths, minus depths",
        false => "mouths have no heights: heights are negative depths",
    };
    let mut lines = vec![("boreholes", format!("{} rows; {mouths}", report.features))];
    let names = report.other_names.join(", ");
    let more = if report.others > report.other_names.len() as u64 { " ..." } else { "" };
    let others = format!("are of layers that --tin does not name, and left out: {names}{more}");
    let counts = [
        ("repeated", report.repeated, "have the borehole, layer and depth of another one"),
        ("other", report.others, &others),
        ("left out", report.without_layer, "have no name of a layer"),
        ("left out", report.without_position, "have no position"),
        ("left out", report.without_mouth, "have no height of the mouth"),
    ];
    let counts = counts.into_iter().filter(|(_, count, _)| *count > 0);
    lines.extend(counts.map(|(name, count, text)| (name, format!("{count} rows {text}"))));
    lines
}

/// Returns lines about points and breaklines.
fn count_lines(report: &SurfaceReport) -> Lines {
    let counts = [
        ("duplicates", report.duplicates, "points have the position of another one"),
        ("averaged", report.averaged, "positions have several heights, and get their mean"),
        (
            "extended",
            report.extended,
            "points and vertices are outside of the convex hull of a surface's points, and get the height of its nearest point",
        ),
        ("crossings", report.crossings, "points were made where the outline crosses a breakline"),
    ];
    let count_lines = counts.into_iter().filter(|(_, count, _)| *count > 0);
    count_lines.map(|(name, count, text)| (name, format!("{count} {text}"))).collect()
}

/// Smooths a surface, if there is any smoothing, and adds a line about it.
fn smoothed(
    tin: Tin,
    smoothing: Option<Smoothing>,
    lines: &mut Lines,
    progress: &dyn Progress,
) -> Result<Tin> {
    let Some(smoothing) = smoothing else { return Ok(tin) };
    let (tin, moved) = tin.smoothed(&smoothing, progress)?;
    lines.push(smoothed_line(&smoothing, moved));
    Ok(tin)
}

/// Returns a line about smoothing.
fn smoothed_line(smoothing: &Smoothing, moved: f64) -> (&'static str, String) {
    let what = if smoothing.keeps_points { "between points" } else { "of points" };
    let passes = if smoothing.passes == 1 { "1 pass".into() } else { format!("{} passes", smoothing.passes) };
    ("smoothed", format!("{passes}; heights {what} moved by at most {moved}"))
}

/// Returns a line about heights that were raised.
fn clipped_line(clipped: u64) -> Option<(&'static str, String)> {
    let text = "heights of upper surfaces were below the next one, and are raised to it";
    (clipped > 0).then(|| ("clipped", format!("{clipped} {text}")))
}

/// Returns the input of several surfaces. (The report counts points whose heights differ.)
fn layer_input(
    names: Vec<String>,
    points: Vec<Vec<[f64; 3]>>,
    breaklines: Vec<Vec<[f64; 3]>>,
    outlines: PolygonParts,
) -> LayerInput {
    let surfaces = names.into_iter().zip(points);
    let flat = |line: Vec<[f64; 3]>| line.into_iter().map(|[x, y, _]| [x, y]).collect();
    LayerInput {
        surfaces: surfaces.map(|(name, points)| LayerSurface { name, points }).collect(),
        breaklines: breaklines.into_iter().map(flat).collect(),
        outlines,
        duplicates: Duplicates::Mean,
    }
}

impl SurfaceImport {
    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Whether the output is a mesh of triangles, not a tree.
    pub(super) fn is_mesh(&self) -> bool {
        matches!(self.target, Target::Mesh(_))
    }

    /// Builds the file. Returns lines about it.
    pub(super) fn build(self, output: Output, progress: &dyn Progress) -> Result<Lines> {
        let SurfaceImport { points, names, target, smoothing, provenance, .. } = self;
        let SurfacePoints { points, breaklines, outlines, crs, crs_file, .. } = points;
        let duplicates = Duplicates::Mean;
        match target {
            Target::Raster(cell, memory, packing) => {
                let points = points.into_iter().next().unwrap_or_default();
                let input = SurfaceInput { points, breaklines, outlines, duplicates };
                let (tin, report) = triangulate(&input)?;
                let mut lines = count_lines(&report);
                let tin = smoothed(tin, smoothing, &mut lines, progress)?;
                let name = names.into_iter().next().unwrap_or_default();
                let raster = SurfaceRaster { cell, name, crs, provenance, memory, packing };
                let [columns, rows] = write_surface(&tin, raster, output, progress)?;
                lines.push((
                    "surface",
                    format!("{} triangles, {columns} x {rows} cells", tin.triangles().len()),
                ));
                Ok(lines)
            }
            Target::Mesh(format) => {
                let (tins, mut lines) = match names.len() {
                    1 => {
                        let points = points.into_iter().next().unwrap_or_default();
                        let input = SurfaceInput { points, breaklines, outlines, duplicates };
                        let (tin, report) = triangulate(&input)?;
                        let mut lines = count_lines(&report);
                        (vec![smoothed(tin, smoothing, &mut lines, progress)?], lines)
                    }
                    _ => {
                        let input = layer_input(names.clone(), points, breaklines, outlines);
                        let mut options = LayerOptions::new();
                        options.smoothing = smoothing;
                        let found = order_surfaces(&input, &options, progress)?;
                        let mut lines = count_lines(&found.surface);
                        lines.extend(smoothing.map(|smoothing| smoothed_line(&smoothing, found.smoothed)));
                        lines.extend(clipped_line(found.clipped));
                        (found.tins, lines)
                    }
                };
                let mesh = |tin: &Tin| SurfaceMesh {
                    vertices: tin.vertices().collect(),
                    triangles: tin.triangles().to_vec(),
                };
                let meshes: Vec<_> =
                    names.into_iter().zip(&tins).map(|(name, tin)| (name, mesh(tin))).collect();
                let frame = Frame { crs, ..Frame::identity() };
                let metadata = Metadata { frame, ..Metadata::default() };
                export_triangles(&meshes, &metadata, output, format, progress)?;
                lines.extend(meshes.iter().map(|(name, mesh)| {
                    let (triangles, vertices) = (mesh.triangles.len(), mesh.vertices.len());
                    ("surface", format!("{name}: {triangles} triangles, {vertices} vertices"))
                }));
                Ok(lines)
            }
            Target::Layers(mut options) => {
                let input = layer_input(names, points, breaklines, outlines);
                let frame = Frame { crs: crs.clone(), ..Frame::identity() };
                let unknown = frame.cell_volume().err().map(|reason| match (&crs, crs_file) {
                    (Some(crs), Some(file)) => format!("{}, in {crs}: {reason}", file.display()),
                    _ => reason.to_owned(),
                });
                options.crs = crs;
                let report = build_layers(&input, &options, output, progress)?;
                let mut lines = count_lines(&report.surface);
                lines.extend(smoothing.map(|smoothing| smoothed_line(&smoothing, report.smoothed)));
                lines.extend(clipped_line(report.clipped));
                for layer in &report.layers {
                    let nothing = if layer.volume > 0.0 { "" } else { "; not in the model" };
                    let measures = match &unknown {
                        Some(reason) => format!("volume and area unknown: {reason}"),
                        None => format!("volume {}, area {}", layer.volume, layer.area),
                    };
                    lines.push(("layer", format!("{}: {measures}{nothing}", layer.name)));
                }
                lines.push(("faces", report.faces.to_string()));
                Ok(lines)
            }
        }
    }
}
