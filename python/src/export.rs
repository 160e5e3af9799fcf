//! Exports: cloud-optimized GeoTIFF, web map tiles, glTF and 3D Tiles.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use spinney::export::{
    CogCompression, CogRequest, GltfOptions, MeshRequest, TileEncoding, TileRequest, export_cog, export_glb,
    export_tileset,
};
use spinney::raw::export::tiles::{
    TileShard, TileTarget, UpdateOptions, degrees_of, draw_tiles, tile_source,
};
use spinney::raw::io::OutputDirectory;
use spinney::style::Style;
use spinney::{Coordinates, WarpOptions};

use crate::error::{OrRaise, invalid};
use crate::files::check_output;
use crate::jobs::{self, Terms};
use crate::numbers::PyNumber;
use crate::region::{coordinates_of, level_of, region_of};
use crate::tree::Tree;

/// Options of tiles. An omitted option has the default of `spinney tiles`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct TileOptions {
    zoom: Option<(u8, u8)>,
    style: Option<String>,
    tile_format: Option<String>,
    tile_size: Option<usize>,
    png_effort: Option<u8>,
    quality: Option<u8>,
    resampling: Option<String>,
    allow_ballpark: bool,
    name: Option<String>,
    attribution: Option<String>,
    resume: bool,
    /// Index from 0 of one fragment of a pyramid, and the number of fragments.
    part: Option<(u32, u32)>,
    /// Archives of all fragments.
    parts: Vec<PathBuf>,
    /// Whether existing tiles are updated.
    update: bool,
    /// Archive that a new one starts from, if it is not the output itself.
    old: Option<PathBuf>,
    since: Option<PathBuf>,
    restyle: bool,
}

impl TileOptions {
    fn warp(&self) -> PyResult<WarpOptions> {
        let mut warp = WarpOptions::default();
        warp.resampling = self.resampling.as_ref().map(|way| way.parse()).transpose().or_raise()?;
        warp.allow_ballpark = self.allow_ballpark;
        Ok(warp)
    }

    fn update(&self) -> Option<UpdateOptions> {
        let mut update = UpdateOptions::default();
        (update.old, update.since, update.restyle) = (self.old.clone(), self.since.clone(), self.restyle);
        self.update.then_some(update)
    }
}

#[pymethods]
impl Tree {
    /// Writes a cloud-optimized GeoTIFF.
    #[pyo3(name = "_write_cog")]
    fn write_cog(
        &self,
        py: Python<'_>,
        path: PathBuf,
        tile_size: Option<u32>,
        compression: Option<&str>,
        nodata: Option<PyNumber>,
        terms: Terms,
    ) -> PyResult<()> {
        let opened = self.get()?;
        check_output(&[opened.tree.name().to_path_buf()], &path)?;
        let mut request = CogRequest::new();
        request.tile_size = tile_size.unwrap_or(request.tile_size);
        request.nodata = nodata.map(|number| number.0);
        request.compression = match compression {
            None | Some("deflate") => CogCompression::Deflate,
            Some("zstd") => CogCompression::Zstd,
            Some("none") => CogCompression::None,
            Some(other) => {
                return Err(invalid(format!("compression: got {other}, expected deflate, zstd or none")));
            }
        };
        jobs::run(py, terms, |work| export_cog(&opened.tree, &request, work.create(&path)?, work))?;
        Ok(())
    }

    /// Writes binary glTF, or 3D Tiles if the name is `x/tileset.json`; returns the number of
    /// triangles.
    #[pyo3(name = "_write_gltf")]
    fn write_gltf(
        &self,
        py: Python<'_>,
        path: PathBuf,
        level: Option<i64>,
        smooth: bool,
        meshopt: bool,
        terms: Terms,
    ) -> PyResult<u64> {
        let opened = self.get()?;
        opened.check_octree()?;
        check_output(&[opened.tree.name().to_path_buf()], &path)?;
        let mut request = MeshRequest::new();
        request.level = level.map(|level| level_of(&opened.tree, Some(level))).transpose()?;
        request.smooth = smooth;
        let mut options = GltfOptions::new();
        options.meshopt = meshopt;
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb")) {
            return jobs::run(py, terms, |work| {
                export_glb(&opened.tree, &request, &options, work.create(&path)?, work)
            });
        }
        let directory = path.parent().filter(|directory| *directory != Path::new(""));
        let directory =
            directory.ok_or_else(|| invalid("path: expected a directory, too, as in x/tileset.json"))?;
        jobs::run(py, terms, |work| {
            let directory = OutputDirectory::create(directory)?;
            export_tileset(&opened.tree, &request, &options, directory, work).map(|made| made.triangles)
        })
    }

    /// Returns whether a name is that of a tile archive, or a pattern of tile names.
    #[staticmethod]
    #[pyo3(name = "_is_tiles")]
    fn is_tiles(path: PathBuf) -> PyResult<bool> {
        Ok(TileTarget::of(&path).or_raise()?.is_some())
    }

    /// Writes web map tiles; returns their number.
    #[pyo3(name = "_write_tiles")]
    fn write_tiles(
        &self,
        py: Python<'_>,
        path: PathBuf,
        window: Option<&Bound<'_, PyAny>>,
        coordinates: Option<&Bound<'_, PyAny>>,
        options: TileOptions,
        terms: Terms,
    ) -> PyResult<u64> {
        let opened = self.get()?;
        let tree = &opened.tree;
        let target = TileTarget::of(&path).or_raise()?;
        let target = target.ok_or_else(|| {
            invalid(format!(
                "{}: is not the name of a tile archive (.pmtiles, .mbtiles) or a pattern of tiles",
                path.display()
            ))
        })?;
        check_output(&[tree.name().to_path_buf()], target.path())?;
        let (warp, update) = (options.warp()?, options.update());
        if update.is_some() && !self.is_file() {
            return Err(invalid("update: got a view, expected a file; export the view to a new archive"));
        }
        let mut request = TileRequest::new(tree).or_raise()?;
        let requested = options.tile_format.as_ref().map(|name| name.parse()).transpose().or_raise()?;
        let format = requested.or(target.format()).unwrap_or_default();
        if target.format().is_some_and(|named| named != format) {
            return Err(invalid("tile_format: differs from the extension of the tiles' names"));
        }
        request.encoding = TileEncoding { format, png_effort: options.png_effort, quality: options.quality };
        request.zooms = options.zoom.map(|(first, last)| first..=last);
        request.side = options.tile_size.unwrap_or(256);
        request.resume = options.resume;
        let part = options.part.map(|(number, of)| TileShard::new(number, of));
        (request.part, request.parts) = (part.transpose().or_raise()?, options.parts.clone());
        request.options = self.steps_text().unwrap_or_default();
        request.name = options.name.clone().unwrap_or(request.name);
        request.attribution = options.attribution.clone().unwrap_or_default();
        let in_degrees = coordinates.map(coordinates_of).transpose()? == Some(Coordinates::LONLAT);
        if let (true, Some(window)) = (in_degrees, window) {
            // (The cells that contain the window would cover a larger box.)
            request.degrees = Some(window.extract()?);
        } else if let Some(bounds) = region_of(tree, window, coordinates)? {
            let frame = tree.metadata().frame.shifted(bounds.min.map(|cell| cell as f64));
            let degrees = degrees_of(&frame, bounds.size(), options.allow_ballpark).or_raise()?;
            request.degrees = Some(degrees);
        }
        let style = match &options.style {
            Some(text) => Style::given(text).or_raise()?,
            None => Style::default_for(tree),
        };
        let stored = jobs::run(py, terms, |work| {
            let last = request.zooms.as_ref().map(|zooms| *zooms.end());
            let tiles = tile_source(tree, request.side, last, &warp, work)?;
            draw_tiles(tree, &*tiles, &style, &mut request, &target, update.as_ref(), work)
        })?;
        Ok(stored.tiles)
    }
}
