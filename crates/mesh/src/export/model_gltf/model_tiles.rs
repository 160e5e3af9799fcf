//! 3D Tiles 1.1 of an exact model: each level of detail is a level of tiles.
//!
//! A tile is a cell of an octree over the model. It has the triangles of its level whose centroids
//! are in the cell, and is replaced by the tiles of the next level in its eight children; by an
//! empty tile if there are none. Adjacent tiles of one level have no gaps; gaps between tiles of
//! different levels are smaller than the larger error of the two.

use std::collections::BTreeMap;

use glam::DVec3;
use serde_json::{Value as Json, json};

use super::super::GltfOptions;
use super::super::losses::Losses;
use super::face_mesh::FaceMesh;
use super::model_glb::{ModelGlbOptions, model_glb};
use super::position::ModelPosition;
use spinney_base::io::{OutputDirectory, Sorter, directory_of};
use spinney_base::parallel;
use spinney_base::space::{Dimension, morton_encode};
use spinney_base::{Error, Progress, Result};
use spinney_brep::query::{Detail, DetailSurface};
use spinney_brep::{ExactModel, Face, Faces, Triangulated};

/// The root is the finest level with at most this many faces.
const ROOT_FACES: u64 = 20_000;
/// Maximum number of faces of a model without levels, which becomes a single tile.
const SINGLE_FACES: u64 = 200_000;
/// Number of tiles that are made concurrently.
const BATCH: usize = 16;
/// Maximum depth of tiles.
const MAX_DEPTH: usize = 20;

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
/// binary glTF file per tile, with objects as features. A tile's geometric error is the bound of
/// its level's distance from the exact surface. The output is a new directory, which is created
/// atomically.
///
/// Models in a known coordinate system are placed on the globe, vertex by vertex; the others keep
/// their coordinates in metres, with z up. Positions are relative to their tile, so that they are
/// accurate to less than a millimetre for tiles of up to a kilometre. About `memory` bytes are
/// used, and temporary files next to the output.
///
/// # Errors
/// If the model has no levels of detail and more than 200,000 faces; if it is corrupt; if its
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
    let first = first.max(levels.len().saturating_sub(MAX_DEPTH));
    let mut writer = TilesWriter {
        model,
        position: ModelPosition::on_globe(model, first_point(model)?, model.path())?,
        options,
        output: &output,
        memory,
        progress,
        is_coloured: model.is_coloured()?,
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
        let surface: DetailSurface<'_> = model.at_detail(Detail::Level(level as u8), None)?;
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

/// A tile: depth, and position of its cell on the curve.
type TileKey = (usize, u64);

/// What is known of a tile.
#[derive(Clone, Copy)]
struct TileAbout {
    /// Origin of its content's coordinates.
    origin: DVec3,
    /// Bounding box of its triangles and of those of all tiles below.
    bounds: [DVec3; 2],
    has_content: bool,
}

struct TilesWriter<'a> {
    model: &'a ExactModel,
    position: ModelPosition<'a>,
    options: &'a GltfOptions,
    output: &'a OutputDirectory,
    memory: u64,
    progress: &'a dyn Progress,
    is_coloured: bool,
    tiles: BTreeMap<TileKey, TileAbout>,
    /// Error of each level of tiles in metres.
    errors: Vec<f64>,
    /// Number of faces of all levels.
    total: u64,
    summary: ModelTilesSummary,
}

/// Bytes of a sorted triangle: position of its cell, vertices, colours, part.
const ITEM: usize = 8 + 36 + 9 + 4;

impl TilesWriter<'_> {
    /// Writes all tiles of a level. `error` is in the unit of the model's coordinates.
    fn level(&mut self, faces: &dyn Faces, depth: usize, error: f64) -> Result<()> {
        self.errors.push(error * self.position.metres());
        self.summary.levels += 1;
        let mut sorter = Sorter::new(directory_of(self.output.path()), self.memory / 4);
        let bits = self.model.grid().bits;
        Triangulated::of(faces)?.each(&mut |face| {
            if face.number.is_multiple_of(1 << 12) {
                self.progress.check()?;
                self.progress.advance(1 << 12, self.total);
            }
            let key = cell_of(face, depth, bits);
            let mut item = Vec::with_capacity(ITEM);
            item.extend_from_slice(&key.to_le_bytes());
            face.points.as_flattened().iter().for_each(|at| item.extend_from_slice(&at.to_le_bytes()));
            let colours = [0, 1, 2].map(|corner| face.colours.get(corner).copied().unwrap_or_default());
            item.extend_from_slice(colours.as_flattened());
            item.extend_from_slice(&face.part.to_le_bytes());
            sorter.push(key, &item)
        })?;
        let mut open: Vec<(u64, Vec<u8>)> = Vec::new();
        let mut batch: Vec<(u64, Vec<u8>)> = Vec::new();
        sorter.finish(&mut |item| {
            let key = u64::from_le_bytes(item[..8].try_into().expect("eight bytes"));
            if open.last().is_none_or(|tile| tile.0 != key) {
                batch.append(&mut open);
                if batch.len() >= BATCH {
                    self.write(std::mem::take(&mut batch), depth)?;
                }
                open.push((key, Vec::new()));
            }
            open[0].1.extend_from_slice(&item[8..]);
            Ok(())
        })?;
        batch.append(&mut open);
        self.write(batch, depth)
    }

    /// Writes tiles, each of the items of its triangles without keys.
    fn write(&mut self, tiles: Vec<(u64, Vec<u8>)>, depth: usize) -> Result<()> {
        let this = &*self;
        let made = parallel::map(&tiles, |(key, items)| -> Result<(u64, TileAbout)> {
            this.progress.check()?;
            let mesh = this.mesh(items)?;
            let [low, high] = mesh.bounds().unwrap_or_default();
            let bounds = [low, high].map(|corner| DVec3::from(corner.map(f64::from)) + mesh.origin);
            let (count, origin) = (mesh.triangles.len() as u64, mesh.origin);
            let (is_coloured, meshopt) = (this.is_coloured, this.options.meshopt);
            let options = ModelGlbOptions { is_coloured, meshopt, origin, about: None };
            let glb = model_glb(this.model, &[mesh], options)?;
            this.output.write(&name((depth, *key)), &glb)?;
            Ok((count, TileAbout { origin, bounds, has_content: true }))
        });
        for ((key, _), made) in tiles.iter().zip(made) {
            let (count, about) = made?;
            self.summary.triangles += count;
            self.summary.tiles += 1;
            self.tiles.insert((depth, *key), about);
            self.widen((depth, *key), &about);
        }
        Ok(())
    }

    /// Adds a tile's bounding box to those of all tiles above.
    fn widen(&mut self, (depth, key): TileKey, below: &TileAbout) {
        let [low, high] = below.bounds;
        for above in (0..depth).rev() {
            let key = key >> (3 * (depth - above));
            let new = TileAbout { has_content: false, ..*below };
            let tile = self.tiles.entry((above, key)).or_insert(new);
            tile.bounds = [tile.bounds[0].min(low), tile.bounds[1].max(high)];
        }
    }

    fn mesh(&self, items: &[u8]) -> Result<FaceMesh> {
        let place = |point: [i32; 3]| self.position.at(point);
        let mut mesh: Option<FaceMesh> = None;
        for item in items.chunks_exact(ITEM - 8) {
            let four = |at: usize| <[u8; 4]>::try_from(&item[at..at + 4]).expect("four bytes");
            let points = [0, 12, 24].map(|at| [0, 4, 8].map(|axis| i32::from_le_bytes(four(at + axis))));
            let colours = [36, 39, 42].map(|at| [item[at], item[at + 1], item[at + 2]]);
            let colours = if self.is_coloured { &colours[..] } else { &[] };
            let part = u32::from_le_bytes(four(45));
            let face = Face { number: 0, points: &points, ring_ends: &[3], colours, part, source: 0 };
            if mesh.is_none() {
                mesh = Some(FaceMesh::at(place(points[0])?));
            }
            mesh.as_mut().expect("it was made above").push(&face, &place)?;
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
        let Some(root) = self.tiles.get(&(0, 0)) else {
            let nothing = json!({ "box": [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] });
            let root = json!({ "boundingVolume": nothing, "geometricError": 0, "refine": "REPLACE" });
            return json!({ "asset": asset, "geometricError": 0, "root": root });
        };
        // (Without the root, nothing is shown: the error is the size of all.)
        let [low, high] = root.bounds;
        let mut tileset = json!({
            "asset": asset,
            "geometricError": low.distance(high).max(self.errors[0]),
            "root": self.tile((0, 0), DVec3::ZERO),
        });
        tileset["root"]["refine"] = "REPLACE".into();
        tileset
    }

    /// Returns a tile with all tiles below. `origin` is that of the tile above.
    fn tile(&self, (depth, key): TileKey, origin: DVec3) -> Json {
        let TileAbout { origin: own, bounds: [low, high], has_content } = self.tiles[&(depth, key)];
        let centre = (low + high) / 2.0 - own;
        // (Positions are rounded to single precision.)
        let half = (high - low) / 2.0 * (1.0 + 1e-6) + DVec3::splat(1e-6);
        let shift = own - origin;
        let mut tile = json!({
            "boundingVolume": { "box": [centre.x, centre.y, centre.z,
                half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z] },
            "geometricError": self.errors[depth],
            "transform": [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0,
                shift.x, shift.y, shift.z, 1.0],
        });
        if has_content {
            tile["content"] = json!({ "uri": name((depth, key)) });
        }
        let children = self.tiles.range((depth + 1, key << 3)..(depth + 1, (key + 1) << 3));
        let mut children: Vec<Json> = children.map(|(child, _)| self.tile(*child, own)).collect();
        if children.is_empty() && depth + 1 < self.errors.len() {
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

/// Returns the position on the curve of the cell at a depth that contains a triangle's centroid.
fn cell_of(face: &Face<'_>, depth: usize, bits: u8) -> u64 {
    let cell = |axis: usize| {
        let sum: i64 = face.points.iter().map(|point| i64::from(point[axis])).sum();
        morton_encode(Dimension::Oct, (((sum / 3) << depth) >> bits) as u32)
    };
    cell(0) | cell(1) << 1 | cell(2) << 2
}

/// Returns the name of a tile's content.
fn name((depth, key): TileKey) -> String {
    format!("content/{depth}/{key}.glb")
}
