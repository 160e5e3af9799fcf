//! 3D Tiles 1.1 of an exact model: each level of detail is a level of tiles.
//!
//! A tile is a cell of an octree over the model. It has the triangles of its level whose centroids
//! are in the cell, and is replaced by the tiles of the next level in its octants; by an empty tile
//! if there are none. Cells are divided further until tiles have few triangles. Adjacent tiles of
//! one level have no gaps; gaps between tiles of different levels are smaller than the larger error
//! of the two.

use std::collections::BTreeMap;

use glam::DVec3;
use serde_json::{Value as Json, json};

use super::super::GltfOptions;
use super::super::losses::Losses;
use super::face_mesh::FaceMesh;
use super::level_cells::{CellCode, LevelCells, curve_position};
use super::model_glb::{ModelGlbOptions, model_glb};
use super::position::ModelPosition;
use spinney_base::io::{OutputDirectory, Sorter, directory_of};
use spinney_base::parallel;
use spinney_base::{Error, Progress, Result};
use spinney_brep::query::SurfaceDetail;
use spinney_brep::{ExactModel, Face, Faces, each_triangle};

/// The root is the finest level with at most this many faces.
const ROOT_FACES: u64 = 20_000;
/// Maximum number of faces of a model without levels, which becomes tiles of one level.
const SINGLE_FACES: u64 = 200_000;
/// Number of tiles that are made concurrently.
const BATCH: usize = 16;
/// Maximum number of levels.
const MAX_LEVELS: usize = 20;
/// Maximum number of triangles of a tile.
const MAX_TRIANGLES: usize = 1 << 15;

/// Size of a tileset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ModelTilesSummary {
    /// Tiles with content.
    pub tiles: u64,
    /// Levels of tiles.
    pub levels: u8,
    /// Triangles of all tiles.
    pub triangles: u64,
    /// Whether positions are geocentric.
    pub is_on_globe: bool,
}

/// Writes an exact model with levels of detail as a tileset of 3D Tiles 1.1: `tileset.json`, and a
/// binary glTF file per tile, of at most 32,768 triangles, with objects as features. A tile's
/// geometric error is the bound of its level's distance from the exact surface. The output is a new
/// directory, which is created atomically.
///
/// Models in a known coordinate system are placed on the globe, vertex by vertex; the others keep
/// their coordinates in metres, with z up. Positions are relative to their tile and rounded by at
/// most a quarter of a millimetre, equally in all tiles of up to 8 km. About `memory` bytes are
/// used, and temporary files next to the output.
///
/// # Errors
/// If the model has no levels of detail and more than 200,000 faces; if it is corrupt; if more than
/// 32,768 triangles have their centroids in one position; if its
/// coordinates are outside of the area of its coordinate system; if the directory exists and is not
/// empty, or cannot be written; or on cancellation.
pub fn export_model_tileset(
    model: &ExactModel,
    options: &GltfOptions,
    output: OutputDirectory,
    memory: u64,
    progress: &dyn Progress,
) -> Result<ModelTilesSummary> {
    options.check()?;
    let levels = model.levels();
    let faces = model.len();
    if levels.is_empty() && faces > SINGLE_FACES {
        let advice = "add levels with `spinney transform FILE levels -o OUTPUT`";
        let found = format!("a model of {faces} faces without levels of detail");
        return Err(Error::unsupported(model.path(), found, advice));
    }
    let first = levels.iter().rposition(|level| level.faces <= ROOT_FACES).unwrap_or(0);
    let first = first.max(levels.len().saturating_sub(MAX_LEVELS));
    let mut writer = TilesWriter {
        model,
        position: ModelPosition::on_globe(model, first_point(model)?, model.path())?,
        options,
        output: &output,
        memory,
        progress,
        is_coloured: model.is_coloured()?,
        cells: LevelCells::default(),
        tiles: BTreeMap::new(),
        errors: Vec::new(),
        total: levels.iter().skip(first).map(|level| level.faces).sum::<u64>().max(faces),
        summary: ModelTilesSummary::default(),
    };
    writer.summary.is_on_globe = writer.position.is_on_globe();
    if levels.is_empty() {
        writer.level(model, 0, 0.0)?;
    }
    for (depth, level) in (first..levels.len()).enumerate() {
        let surface = model.surface(SurfaceDetail::Level(level as u8), None, progress)?;
        writer.level(&surface, depth, levels[level].error * model.grid().width())?;
    }
    let mut text = serde_json::to_vec(&writer.tileset()).expect("keys are strings");
    text.push(b'\n');
    let summary = writer.summary;
    output.write("tileset.json", &text)?;
    model.check_unchanged()?;
    let mut losses = Losses::in_file(&output.path().join("tileset.json"));
    losses.add(!model.value_columns()?.is_empty(), "values of faces");
    losses.add(!model.file_attributes()?.is_empty(), "the metadata of source files");
    if !summary.is_on_globe {
        losses.add_crs(model.crs());
    }
    output.commit()?;
    losses.report(progress);
    Ok(summary)
}

/// Returns a point of the model, or of its grid if there are no faces.
fn first_point(model: &ExactModel) -> Result<[f64; 3]> {
    let mut buffer = spinney_brep::FaceBuffer::default();
    if !model.is_empty() {
        model.face(0, &mut buffer)?;
    }
    Ok(model.grid().to_world(buffer.points.first().copied().unwrap_or_default()))
}

/// A tile: level, counted from the root, and cell.
type TileKey = (usize, CellCode);

/// What is known of a tile.
#[derive(Clone)]
struct TileAbout {
    /// Origin of its content's coordinates.
    origin: DVec3,
    /// Bounding box of its triangles and of those of all tiles below.
    bounds: [DVec3; 2],
    has_content: bool,
    /// Cells of the tiles of the next level that replace it.
    children: Vec<CellCode>,
}

struct TilesWriter<'a> {
    model: &'a ExactModel,
    position: ModelPosition<'a>,
    options: &'a GltfOptions,
    output: &'a OutputDirectory,
    memory: u64,
    progress: &'a dyn Progress,
    is_coloured: bool,
    cells: LevelCells,
    tiles: BTreeMap<TileKey, TileAbout>,
    /// Error of each level of tiles in metres.
    errors: Vec<f64>,
    /// Number of faces of all levels.
    total: u64,
    summary: ModelTilesSummary,
}

/// Bytes of a sorted triangle: position on the curve, vertices, colours, part.
const ITEM: usize = 8 + 36 + 9 + 4;

impl TilesWriter<'_> {
    /// Writes all tiles of a level. `error` is in the unit of the model's coordinates.
    fn level(&mut self, faces: &dyn Faces, level: usize, error: f64) -> Result<()> {
        self.cells.add_level();
        self.errors.push(error * self.position.metres());
        self.summary.levels += 1;
        let mut sorter = Sorter::new(directory_of(self.output.path()), self.memory / 4);
        let bits = self.model.grid().bits;
        let mut item = Vec::with_capacity(ITEM);
        each_triangle(faces, &mut |face| {
            if face.number.is_multiple_of(1 << 12) {
                self.progress.check()?;
                self.progress.advance(1 << 12, self.total);
            }
            let key = curve_position(face, bits);
            item.clear();
            item.extend_from_slice(&key.to_le_bytes());
            face.points.as_flattened().iter().for_each(|at| item.extend_from_slice(&at.to_le_bytes()));
            let colours = [0, 1, 2].map(|corner| face.colours.get(corner).copied().unwrap_or_default());
            item.extend_from_slice(colours.as_flattened());
            item.extend_from_slice(&face.part.to_le_bytes());
            sorter.push(key, &item)
        })?;
        let (mut open, mut batch) = (OpenTile::default(), Vec::new());
        sorter.finish(&mut |item| {
            let cell = self.cells.cell(level, position_of(item));
            if open.cell != cell {
                batch.push(std::mem::replace(&mut open, OpenTile { cell, items: Vec::new() }));
            }
            open.items.extend_from_slice(item);
            while open.items.len() > MAX_TRIANGLES * ITEM {
                self.divide(level, &mut open, &mut batch)?;
            }
            if batch.len() >= BATCH {
                self.write(std::mem::take(&mut batch), level)?;
            }
            Ok(())
        })?;
        batch.push(open);
        self.write(batch, level)
    }

    /// Divides the cell of a tile. The last octant with triangles, which may get more, remains
    /// open; the others are complete.
    fn divide(&mut self, level: usize, open: &mut OpenTile, complete: &mut Vec<OpenTile>) -> Result<()> {
        if !self.cells.divide(open.cell) {
            let found = format!("more than {MAX_TRIANGLES} triangles of a level in one position");
            let advice = "remove repeated objects, or write glTF (x.glb)";
            return Err(Error::unsupported(self.model.path(), found, advice));
        }
        let items = std::mem::take(&mut open.items);
        for item in items.chunks_exact(ITEM) {
            let cell = self.cells.cell(level, position_of(item));
            if open.cell != cell {
                complete.push(std::mem::replace(open, OpenTile { cell, items: Vec::new() }));
            }
            open.items.extend_from_slice(item);
        }
        Ok(())
    }

    fn write(&mut self, tiles: Vec<OpenTile>, level: usize) -> Result<()> {
        let tiles: Vec<OpenTile> = tiles.into_iter().filter(|tile| !tile.items.is_empty()).collect();
        let this = &*self;
        let made = parallel::map(&tiles, |OpenTile { cell, items }| -> Result<(u64, TileAbout)> {
            this.progress.check()?;
            let mesh = this.mesh(items)?;
            let [low, high] = mesh.bounds().unwrap_or_default();
            let bounds = [low, high].map(|corner| DVec3::from(corner.map(f64::from)) + mesh.origin);
            let (count, origin) = (mesh.triangles.len() as u64, mesh.origin);
            let (is_coloured, meshopt) = (this.is_coloured, this.options.meshopt);
            let options = ModelGlbOptions { is_coloured, meshopt, origin, ..Default::default() };
            let glb = model_glb(this.model, &[mesh], options)?;
            this.output.write(&name((level, *cell)), &glb)?;
            Ok((count, TileAbout { origin, bounds, has_content: true, children: Vec::new() }))
        });
        for (tile, made) in tiles.iter().zip(made) {
            let (count, about) = made?;
            self.summary.triangles += count;
            self.summary.tiles += 1;
            self.add((level, tile.cell), about);
        }
        Ok(())
    }

    /// Adds a tile, and all missing tiles above it, whose bounding boxes are enlarged.
    fn add(&mut self, key: TileKey, about: TileAbout) {
        let TileAbout { origin, bounds: [low, high], .. } = about;
        let (mut below, mut is_new) = (key, self.tiles.insert(key, about).is_none());
        while let Some(cell) = self.cells.above(below.0, below.1) {
            let above = (below.0 - 1, cell);
            let mut was_missing = false;
            let tile = self.tiles.entry(above).or_insert_with(|| {
                was_missing = true;
                TileAbout { origin, bounds: [low, high], has_content: false, children: Vec::new() }
            });
            tile.bounds = united(tile.bounds, [low, high]);
            if is_new {
                tile.children.push(below.1);
            }
            (below, is_new) = (above, was_missing);
        }
    }

    fn mesh(&self, items: &[u8]) -> Result<FaceMesh> {
        let place = |point: [i32; 3]| self.position.at(point);
        let mut mesh: Option<FaceMesh> = None;
        for item in items.chunks_exact(ITEM) {
            let four = |at: usize| <[u8; 4]>::try_from(&item[8 + at..12 + at]).expect("four bytes");
            let points = [0, 12, 24].map(|at| [0, 4, 8].map(|axis| i32::from_le_bytes(four(at + axis))));
            let colours = [44, 47, 50].map(|at| [item[at], item[at + 1], item[at + 2]]);
            let colours = if self.is_coloured { &colours[..] } else { &[] };
            let part = u32::from_le_bytes(four(45));
            let face = Face { number: 0, points: &points, ring_ends: &[3], colours, part, source: 0 };
            if mesh.is_none() {
                mesh = Some(FaceMesh::at(place(points[0])?));
            }
            mesh.as_mut().expect("it was made above").push(&face, 0, &place)?;
        }
        Ok(mesh.unwrap_or_default())
    }

    /// Returns the content of `tileset.json`.
    fn tileset(&self) -> Json {
        let mut asset = json!({ "version": "1.1", "generator": "spinney" });
        if let Some(crs) = self.model.crs() {
            let note = match self.summary.is_on_globe {
                true => "vertices are in EPSG:4978",
                false => "transforms lead to coordinates of this system, not to those of EPSG:4978",
            };
            asset["extras"] = json!({ "crs": crs.definition(), "note": note });
        }
        let roots: Vec<(&TileKey, &TileAbout)> = self.tiles.range((0, 0)..(1, 0)).collect();
        let Some(bounds) = roots.iter().map(|(_, tile)| tile.bounds).reduce(united) else {
            let nothing = json!({ "box": [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] });
            let root = json!({ "boundingVolume": nothing, "geometricError": 0, "refine": "REPLACE" });
            return json!({ "asset": asset, "geometricError": 0, "root": root });
        };
        // (Without the root, nothing is shown: the error is the size of all.)
        let error = bounds[0].distance(bounds[1]).max(self.errors[0]);
        let mut tiles: Vec<Json> = roots.iter().map(|(key, _)| self.tile(**key, DVec3::ZERO)).collect();
        let mut root = match tiles.pop() {
            Some(root) if tiles.is_empty() => root,
            last => {
                tiles.extend(last);
                json!({ "boundingVolume": volume(bounds, DVec3::ZERO), "geometricError": error, "children": tiles })
            }
        };
        root["refine"] = "REPLACE".into();
        json!({ "asset": asset, "geometricError": error, "root": root })
    }

    /// Returns a tile with all tiles below. `origin` is that of the tile above.
    fn tile(&self, (level, cell): TileKey, origin: DVec3) -> Json {
        let TileAbout { origin: own, bounds, has_content, ref children } = self.tiles[&(level, cell)];
        let shift = own - origin;
        let mut tile = json!({
            "boundingVolume": volume(bounds, own),
            "geometricError": self.errors[level],
            "transform": [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0,
                shift.x, shift.y, shift.z, 1.0],
        });
        if has_content {
            tile["content"] = json!({ "uri": name((level, cell)) });
        }
        let mut children: Vec<Json> =
            children.iter().map(|child| self.tile((level + 1, *child), own)).collect();
        if children.is_empty() && level + 1 < self.errors.len() {
            // The next level has no triangles here. Without a replacement, viewers would show these
            // triangles together with the exact surface.
            let nothing = json!({ "boundingVolume": tile["boundingVolume"], "geometricError": 0.0 });
            children.push(nothing);
        }
        if !children.is_empty() {
            tile["children"] = children.into();
        }
        tile
    }
}

/// A tile that gets triangles.
#[derive(Default)]
struct OpenTile {
    cell: CellCode,
    /// Its triangles, [`ITEM`] bytes each.
    items: Vec<u8>,
}

/// Returns the position on the curve of a sorted triangle.
fn position_of(item: &[u8]) -> u64 {
    item.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

/// Returns the box that contains two boxes.
fn united(a: [DVec3; 2], b: [DVec3; 2]) -> [DVec3; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Relative error of sums of positions in single precision: above 2^-23, that of a number.
const ROUNDING: f64 = 1e-6;
/// Margin of a volume in metres, since one without an extent is not valid: a micrometre.
const MARGIN: f64 = 1e-6;

/// Returns the bounding volume of a box, relative to an origin.
fn volume([low, high]: [DVec3; 2], origin: DVec3) -> Json {
    let centre = (low + high) / 2.0 - origin;
    let half = (high - low) / 2.0 * (1.0 + ROUNDING) + DVec3::splat(MARGIN);
    json!({ "box": [centre.x, centre.y, centre.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z] })
}

/// Returns the name of a tile's content.
fn name((level, cell): TileKey) -> String {
    format!("content/{level}/{cell}.glb")
}
