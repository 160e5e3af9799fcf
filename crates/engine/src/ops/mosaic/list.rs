//! Creation and update of manifests.

use std::collections::{BTreeSet, HashMap};
use std::path::{Component, Path, PathBuf};

use super::files::open_goblin;
use crate::ops::reconcile::{CommonGrid, Located, OutputExtent, Position};
use crate::ops::view_source::check_form;
use spinney_base::io::{FileAccess, local_path, shown, url_of};
use spinney_base::space::Bounds;
use spinney_base::value::DataKind;
use spinney_base::{Error, Progress, Result};
use spinney_container::{FileReference, HEAVY_THRESHOLD, Header, Metadata, STRIDE, Shape, Tag, reach};
use spinney_manifest::{ListedFile, Manifest};

/// File to be listed.
struct InspectedFile {
    entry: ListedFile,
    name: String,
    header: Header,
    metadata: Metadata,
}

/// Creates a manifest at a path, or updates the existing one if `is_update`: removes the files that
/// `removed` names, and puts the `added` ones on top of the others. A file that is listed already
/// keeps its position, and its entry is refreshed. The manifest is locked meanwhile and replaced as
/// a whole at the end.
///
/// # Errors
/// [`Error::Locked`] if another process is changing it; if a file cannot be read, has another tree
/// type or grid than the others, or a name to remove is not listed; or on cancellation.
pub fn list_files(
    path: &Path,
    is_update: bool,
    added: &[PathBuf],
    removed: &[String],
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<Manifest> {
    Manifest::update(path, is_update, access, &mut |before| {
        let mut manifest = before;
        if let Some(manifest) = &mut manifest {
            remove(path, manifest, removed)?;
        }
        let mut files = Vec::with_capacity(added.len());
        for file in added {
            progress.check()?;
            files.push(inspect(path, file, access)?);
        }
        let Some(first) = files.first() else {
            return manifest.ok_or_else(|| Error::invalid("files of a manifest", "none", "at least one"));
        };
        let manifest = match manifest {
            Some(manifest) => manifest,
            None => Manifest {
                header: Header {
                    codec: Default::default(),
                    shape: Shape {
                        reach: reach(first.header.form.dimension),
                        stride: STRIDE,
                        heavy_threshold: HEAVY_THRESHOLD,
                        ..first.header.shape
                    },
                    ..first.header.clone()
                },
                metadata: common_part(&first.metadata),
                entries: Vec::new(),
            },
        };
        let mut left = BTreeSet::new();
        let manifest = add(path, manifest, files, &mut left)?;
        if !left.is_empty() {
            let left = left.into_iter().collect::<Vec<_>>().join(", ");
            progress.warn(
                path,
                &format!("the files differ in {left}: the manifest keeps only what all files have in common"),
            );
        }
        Ok(manifest)
    })
}

/// Removes files from a manifest.
fn remove(path: &Path, manifest: &mut Manifest, removed: &[String]) -> Result<()> {
    for name in removed {
        let named = stored_name(path, Path::new(name)).unwrap_or_default();
        let before = manifest.entries.len();
        manifest.entries.retain(|entry| entry.path != *name && entry.path != named);
        if manifest.entries.len() == before {
            let expected = format!("a file in {}", path.display());
            return Err(Error::invalid("file to remove", name.as_str(), expected));
        }
    }
    Ok(())
}

/// Opens a file and makes its entry; its position is computed later.
fn inspect(manifest: &Path, path: &Path, access: &FileAccess) -> Result<InspectedFile> {
    let place = FileReference::of(path);
    let (file, tag) = open_goblin(&place.file, place.layer.as_deref(), &access.into())?;
    if place.layer.is_none() && file.layers().len() > 1 {
        let example = place.of_layer(&file.layers()[0].name);
        let advice = format!("name a layer, as in {}", example.display());
        let found = format!("a file of {} layers instead of one", file.layers().len());
        return Err(Error::unsupported(path, found, advice));
    }
    let header = file.header().clone();
    Ok(InspectedFile {
        entry: ListedFile {
            path: stored_name(manifest, &place.file)?,
            layer: place.layer.clone(),
            bounds: header.extent_bounds(),
            depth: header.depth(),
            tag,
        },
        name: path.display().to_string(),
        metadata: file.metadata().clone(),
        header,
    })
}

/// Name of a file in a manifest: relative to the manifest's directory if it was given relatively.
fn stored_name(manifest: &Path, file: &Path) -> Result<String> {
    let text = |path: &Path| {
        path.to_str()
            .map(Into::into)
            .ok_or_else(|| Error::unsupported(path, "a name that is no text", "give the file another name"))
    };
    if url_of(file).is_some() {
        // (Signatures and passwords are supplied again when the manifest is opened.)
        return Ok(shown(file).into_owned());
    }
    let file = &*local_path(file);
    if file.is_absolute() {
        return text(file);
    }
    let directory = |path: &Path| {
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        parent.canonicalize().map_err(Error::io(parent, "find"))
    };
    let (from, to) = (directory(manifest)?, directory(file)?);
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(to.components().skip(common)).collect();
    text(&relative.join(file.file_name().unwrap_or_default()))
}

/// Metadata that a manifest copies from a file: those about its cells, not about its making.
fn common_part(metadata: &Metadata) -> Metadata {
    Metadata {
        name: String::new(),
        counts: Default::default(),
        provenance: Vec::new(),
        scoped_tags: Default::default(),
        control_points: None,
        repeated: 1,
        ..metadata.clone()
    }
}

/// Adds files to a manifest; `left` collects what their metadata do not have in common.
fn add(
    path: &Path,
    mut manifest: Manifest,
    files: Vec<InspectedFile>,
    left: &mut BTreeSet<&'static str>,
) -> Result<Manifest> {
    for file in &files {
        let common = &manifest.header;
        check_form((Path::new(&file.name), file.header.form), (path, common.form))?;
        let same_meaning = (file.header.form, file.header.rule, file.header.kind)
            == (common.form, common.rule, common.kind)
            && file.metadata.scale_offset == manifest.metadata.scale_offset
            && file.metadata.alpha == manifest.metadata.alpha;
        if !same_meaning {
            let describe =
                |header: &Header| format!("{} {} values by {}", header.kind, header.form, header.rule);
            let expected = format!(
                "{}, with the same scale, offset and opacity as {}",
                describe(common),
                path.display()
            );
            return Err(Error::invalid(file.name.clone(), describe(&file.header), expected));
        }
        share(path, &mut manifest.metadata, file, left)?;
    }
    // Align all with one grid: that of the manifest, moved so that no cell is negative.
    let located = |name, metadata: &Metadata, extent| {
        Located::new(name, metadata.frame.clone(), metadata.tag(Tag::Unit), extent)
    };
    let own = path.display().to_string();
    // (Messages name a file, since the manifest may not exist yet.)
    let first = manifest.entries.first().map(|entry| entry.path.clone());
    let name = first.or(files.first().map(|file| file.name.clone())).unwrap_or_else(|| own.clone());
    let listed = located(&name, &manifest.metadata, manifest.header.extent);
    let others = files.iter().map(|file| located(&file.name, &file.metadata, file.header.extent));
    let operands: Vec<Located<'_>> = std::iter::once(listed).chain(others).collect();
    let dimension = manifest.header.form.dimension;
    let grid = CommonGrid::of(&operands, dimension, OutputExtent::Union, Position::World)?;
    let shift = |number: usize| {
        grid.shift(number).map(|cells| cells.map(|cells| cells.max(0) as u64)).ok_or_else(|| {
            let file = operands[number].name;
            let expected = format!(
                "the cells of {name}; to resample it: `spinney transform {file} like={name} -o OTHER.goblin`"
            );
            Error::invalid(
                format!("grid of {file}"),
                "cells of another size, direction or position",
                expected,
            )
        })
    };
    let shifts = (0..operands.len()).map(shift).collect::<Result<Vec<_>>>()?;
    let moved = shifts[0];
    manifest.metadata.frame = grid.frame.clone();
    drop(operands);
    for ListedFile { bounds, .. } in &mut manifest.entries {
        *bounds = shifted(bounds, moved);
    }
    let known = manifest.entries.iter().enumerate();
    let mut known: HashMap<(String, Option<String>), usize> =
        known.map(|(at, entry)| ((entry.path.clone(), entry.layer.clone()), at)).collect();
    for (file, place) in files.into_iter().zip(&shifts[1..]) {
        let entry = ListedFile { bounds: shifted(&file.entry.bounds, *place), ..file.entry };
        match known.get(&(entry.path.clone(), entry.layer.clone())) {
            Some(at) => manifest.entries[*at] = entry,
            None => {
                known.insert((entry.path.clone(), entry.layer.clone()), manifest.entries.len());
                manifest.entries.push(entry);
            }
        }
    }
    Ok(manifest)
}

fn shifted(bounds: &Bounds, by: [u64; 3]) -> Bounds {
    let moved = |at: [u64; 3]| std::array::from_fn(|axis| at[axis] + by[axis]);
    Bounds { min: moved(bounds.min), max: moved(bounds.max) }
}

/// Keeps in `common` only what a file's metadata share with it, and adds the rest to `left`.
/// Classes of all files are merged.
fn share(
    path: &Path,
    common: &mut Metadata,
    file: &InspectedFile,
    left: &mut BTreeSet<&'static str>,
) -> Result<()> {
    let own = &file.metadata;
    for (class, name) in &own.class_names {
        let known = common.class_names.entry(*class).or_insert_with(|| name.clone());
        if known != name && file.header.kind == DataKind::Categorical {
            let expected = format!("`{known}`, as in {}", path.display());
            return Err(Error::invalid(
                format!("{}: class {class}", file.name),
                format!("`{name}`"),
                expected,
            ));
        }
    }
    if common.palette != own.palette {
        common.palette = None;
        left.insert("colours");
    }
    if common.nodata != own.nodata {
        common.nodata = None;
        left.insert("nodata number");
    }
    if common.time != own.time {
        common.time = None;
        left.insert("time");
    }
    if common.band_names != own.band_names {
        common.band_names.clear();
        left.insert("names of channels");
    }
    if common.units != own.units {
        let found = own.units.join(", ");
        let expected = format!("{}, as in {}", common.units.join(", "), path.display());
        return Err(Error::invalid(format!("{}: units", file.name), found, expected));
    }
    if !own.scoped_tags.is_empty() {
        left.insert("tags of channels and domains");
    }
    if own.control_points.is_some() {
        left.insert("control points");
    }
    if common.tags != own.tags {
        common.tags.retain(|name, value| own.tags.get(name) == Some(value));
        left.insert("tags");
    }
    Ok(())
}
