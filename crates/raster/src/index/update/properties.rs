//! Properties of an updated layer and of its files, as a new index would have them.

use std::path::{Path, PathBuf};

use super::refused;
use crate::import::{
    ImportHistory, ImportOptions, RasterInfo, Validity, apply_options_to_input, grid_offset, kind,
    masked_value_type, metadata, mosaic_layout, provenance,
};
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_container::{Header, Metadata};
use spinney_engine::store::goblin::Goblin;
use spinney_references::PixelRule;

/// Properties of a layer of the old index.
pub(super) struct LayerProperties<'a> {
    index: &'a Path,
    header: &'a Header,
    metadata: &'a Metadata,
    history: ImportHistory<'a>,
    /// The user's options, as far as they change properties of files.
    options: ImportOptions,
    /// Whether the layer is one of several, each of which has a file or bands of its own.
    is_stacked: bool,
    /// The layer as a raster.
    grid: RasterInfo,
}

impl<'a> LayerProperties<'a> {
    pub(super) fn of(layer: &'a Goblin) -> LayerProperties<'a> {
        let (header, metadata) = (layer.header(), layer.metadata());
        let history = ImportHistory::of(&metadata.provenance);
        let ([width, height, _], value) = (header.extent, header.form.value);
        let plain = RasterInfo::plain([width, height], value.sample, usize::from(value.channels));
        let grid = RasterInfo {
            frame: metadata.frame.clone(),
            nodata: metadata.nodata,
            alpha: metadata.alpha.map(usize::from),
            scale_offset: match &metadata.scale_offset[..] {
                [] => plain.scale_offset.clone(),
                numbers => numbers.to_vec(),
            },
            ..plain
        };
        let points = || metadata.control_points.as_ref()?.crs.clone();
        let crs = metadata.frame.crs.clone().or_else(points);
        let options = ImportOptions {
            kind: history.option("kind").map(|_| header.kind),
            crs: crs.filter(|_| history.option("crs").is_some()),
            keep_transparent: history.option("transparent").is_some(),
            ..ImportOptions::default()
        };
        let (index, is_stacked) = (layer.path(), layer.layers().len() > 1);
        LayerProperties { index, header, metadata, history, options, is_stacked, grid }
    }

    /// Returns the properties of a file's channels after the user's options.
    pub(super) fn of_file(&self, file: &RasterInfo, channels: &[usize], are_several: bool) -> RasterInfo {
        let mut info = file.of_channels(channels);
        // The user's number replaces that of each file.
        if self.history.option("nodata").is_some() {
            info.nodata = self.metadata.nodata;
        }
        apply_options_to_input(&mut info, are_several, &self.options, &mut None);
        if self.is_stacked && info.channels == 1 {
            // Opacity as a layer of its own is an ordinary number.
            info.alpha = None;
        }
        info
    }

    /// Whether the user has selected bands.
    pub(super) fn has_selected_bands(&self) -> bool {
        self.history.option("bands").is_some()
    }

    /// Describes in which way the pixels of a file differ from those of the layer.
    pub(super) fn difference(&self, info: &RasterInfo) -> Option<&'static str> {
        let bands = self.history.option("bands").unwrap_or_default();
        let are_named = bands.split(',').any(|band| !band.is_empty() && band.parse::<usize>().is_err());
        let names =
            |names: &[String]| names.iter().filter(|name| !name.is_empty()).cloned().collect::<Vec<_>>();
        if (info.sample, info.channels) != (self.grid.sample, self.grid.channels) {
            Some("type")
        } else if info.alpha != self.grid.alpha {
            Some("opacity")
        } else if info.scale_offset != self.grid.scale_offset {
            Some("scale or offset")
        } else if are_named && names(&info.band_names) != names(&self.metadata.band_names) {
            // The user's names may select other bands of it.
            Some("order of bands")
        } else {
            None
        }
    }

    /// Returns the cell at which a file begins.
    ///
    /// # Errors
    /// If it is not on the layer's grid.
    pub(super) fn position(&self, info: &RasterInfo, path: &Path) -> Result<[i64; 2]> {
        grid_offset((&self.grid, self.index), (info, path))
    }

    /// Returns the rule for the VOID pixels of a source that leaves nodata to the layer.
    pub(super) fn complete(&self, rule: &PixelRule) -> PixelRule {
        let of_layer = Validity::by_all(&self.grid).rule().clone();
        PixelRule { nodata: rule.nodata.clone().or(of_layer.nodata), nan: of_layer.nan, ..rule.clone() }
    }

    /// Checks that the layer of sources with these nodata bytes has the nodata number that it had.
    /// It has none if they differ. Paths and properties are those of sources that were opened.
    pub(super) fn check_nodata(&self, sources: &[(&PixelRule, &Path, Option<RasterInfo>)]) -> Result<()> {
        let before = Validity::by_all(&self.grid).rule().nodata.clone();
        let first = sources.first().and_then(|(rule, ..)| rule.nodata.clone());
        let now = first.filter(|first| sources.iter().all(|(rule, ..)| rule.nodata.as_ref() == Some(first)));
        if now == before {
            return Ok(());
        }
        let text =
            |number: Option<Number>| number.map_or("no nodata number".into(), |it| format!("nodata {it}"));
        let of_index = text(self.metadata.nodata);
        let other = sources.iter().find_map(|(rule, path, info)| {
            info.as_ref().filter(|_| rule.nodata != before).map(|info| (path, info))
        });
        Err(match other {
            Some((path, info)) => {
                refused(path, format!("a source with {}, in an index with {of_index},", text(info.nodata)))
            }
            None => refused(
                self.index,
                format!("sources that all have one nodata number, in an index with {of_index},"),
            ),
        })
    }

    /// Checks that values have the mask and the kind that they had. `first` has the properties of
    /// the first source, if it was opened.
    pub(super) fn check_values(&self, first: Option<&RasterInfo>, are_several: bool) -> Result<()> {
        let channels: Vec<usize> = (0..self.grid.channels).collect();
        let grid = self.of_file(&self.grid, &channels, are_several);
        let info = RasterInfo { nodata: self.metadata.nodata, ..first.unwrap_or(&grid).clone() };
        if masked_value_type(self.index, &info)? != self.header.form.value {
            let found = "sources whose opacity has another meaning than before (one image keeps the colours of its transparent pixels, several do not)";
            return Err(refused(self.index, found));
        }
        let kind = first.map_or(self.header.kind, |first| kind(first, &self.options).0);
        if kind != self.header.kind {
            let found =
                format!("sources whose kind is {kind}, in an index whose kind is {}", self.header.kind);
            return Err(refused(self.index, found));
        }
        Ok(())
    }

    /// Returns the metadata of the layer. `first` has the properties of the first source, which
    /// are those of the layer, unless they are those that the layer has. `inputs` are the paths
    /// of all sources, unless they are those that the provenance has.
    ///
    /// # Errors
    /// If a layer of a stack has another description, since names of layers are made of these.
    pub(super) fn metadata(
        &self,
        first: Option<&RasterInfo>,
        inputs: Option<Vec<PathBuf>>,
    ) -> Result<Metadata> {
        let inputs = inputs.unwrap_or_else(|| self.history.inputs());
        let info = first.unwrap_or(&self.grid);
        let layout = first.map_or(self.history.first_layout(), |first| &first.layout);
        let layout = match inputs.len() {
            0 | 1 => layout.to_string(),
            count => mosaic_layout(count, layout),
        };
        let info = RasterInfo { nodata: self.metadata.nodata, layout, ..info.clone() };
        let mut lines = provenance(&inputs, &info, &ImportOptions::default());
        lines.extend(self.history.other_lines().cloned());
        let old = Metadata { provenance: lines.clone(), ..self.metadata.clone() };
        if first.is_none() {
            return Ok(old);
        }
        let new = Metadata {
            name: old.name.clone(),
            counts: old.counts.clone(),
            time: old.time.clone(),
            repeated: old.repeated,
            provenance: lines,
            ..metadata(old.frame.clone(), &inputs, &info, &ImportOptions::default())
        };
        let description = |it: &Metadata| (it.band_names.clone(), it.colour_roles().join(","));
        if self.is_stacked && description(&old) != description(&new) {
            return Err(refused(
                self.index,
                format!("other names or colours of the bands of layer {}", old.name),
            ));
        }
        Ok(new)
    }

    /// Returns the error for a file that cannot be added.
    pub(super) fn unlike(path: &Path, found: impl Into<String>) -> Error {
        Error::unsupported(path, found, "index the files of each type by themselves (`spinney index`)")
    }
}
