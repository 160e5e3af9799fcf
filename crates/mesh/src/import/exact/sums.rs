//! Sums over the faces of objects: whether they are closed, and their volumes.

use std::collections::BTreeMap;
use std::path::Path;

use super::super::solid::CellVolume;
use super::super::solid::closure::Closure;
use super::boundary::{Groups, edges};
use super::objects::Objects;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{Face, Grid};

/// Compares the volume of a repaired or closed surface with the cell volume of the original models.
pub(super) fn compare(
    volume: f64,
    cells: Option<CellVolume>,
    path: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    /// Relative differences of the volumes above which a warning is issued, and above which it is
    /// an error.
    const MAX_CHANGE: f64 = 0.01;
    const MAX_LOSS: f64 = 0.5;
    let Some(cells) = cells else {
        progress.warn(path, "the volume was not compared with that of cells, which needs more --memory");
        return Ok(());
    };
    let beyond = ((volume - cells.volume).abs() - cells.error).max(0.0);
    let numbers =
        format!("{volume}, but that of the cells of the models is {} +- {}", cells.volume, cells.error);
    if beyond > MAX_LOSS * cells.volume {
        return Err(Error::NotASolid {
            path: path.to_path_buf(),
            what: format!("the repaired or closed surface does not enclose what the models enclose: its volume is {numbers}"),
            locations: Vec::new(),
            count: 0,
            advice: "close the holes in the program that made the model, choose another rule with --inside, or build \
                     cells (without --brep)"
                .into(),
        });
    }
    if beyond > MAX_CHANGE * cells.volume {
        progress.warn(path, &format!("the volume is {numbers}, in cubic model units"));
    }
    Ok(())
}

/// Closedness and volume of each object's surface, or of groups of objects that close each other.
#[derive(Default)]
pub(super) struct ObjectSums {
    objects: BTreeMap<u32, ObjectSum>,
    /// Minimum and maximum coordinates of all faces.
    bounds: Option<[[i32; 3]; 2]>,
}

#[derive(Clone, Copy, Default)]
struct ObjectSum {
    closure: Closure,
    /// Six times the volume, in cubic grid units.
    six_volumes: i128,
    has_area: bool,
}

impl ObjectSums {
    pub(super) fn add(&mut self, object: u32, face: &Face<'_>) {
        for point in face.points {
            let [low, high] = self.bounds.get_or_insert([*point; 2]);
            for axis in 0..3 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        let sum = self.objects.entry(object).or_default();
        edges(face).for_each(|[from, to]| sum.closure.add_edge(from, to));
        sum.six_volumes += face.six_volumes();
        sum.has_area |= face.has_area();
    }

    /// Total volume, in cubic world units.
    pub(super) fn volume(&self, grid: &Grid) -> f64 {
        let six: i128 = self.objects.values().map(|sum| sum.six_volumes).sum();
        six as f64 / 6.0 * grid.width().powi(3)
    }

    /// Bounding box of all faces in world coordinates, if it has volume.
    pub(super) fn bounds(&self, grid: &Grid) -> Option<[[f64; 3]; 2]> {
        let bounds = self.bounds.filter(|[low, high]| (0..3).all(|axis| low[axis] < high[axis]))?;
        Some(bounds.map(|corner| grid.to_world(corner)))
    }

    /// Whether each object is closed (`one_by_one`), or all objects together are.
    pub(super) fn are_closed(&self, one_by_one: bool) -> bool {
        if one_by_one {
            return self.objects.values().all(|sum| sum.closure.is_closed());
        }
        let mut all = Closure::default();
        self.objects.values().for_each(|sum| all.append(&sum.closure));
        all.is_closed()
    }

    /// Whether some object is closed by itself.
    pub(super) fn has_closed(&self) -> bool {
        self.objects.values().any(|sum| sum.closure.is_closed())
    }

    /// Joins objects that close each other.
    pub(super) fn join(&mut self, groups: &Groups) {
        for (object, sum) in std::mem::take(&mut self.objects) {
            let all = self.objects.entry(groups.group(object)).or_default();
            all.closure.append(&sum.closure);
            all.six_volumes += sum.six_volumes;
            all.has_area |= sum.has_area;
        }
    }

    /// Fails if a closed object has no volume, or if all objects together have none.
    pub(super) fn check(&self, path: &Path, objects: &Objects) -> Result<()> {
        let flat = |sum: &ObjectSum| sum.closure.is_closed() && sum.six_volumes == 0 && sum.has_area;
        let flat: Vec<u32> =
            self.objects.iter().filter(|(_, sum)| flat(sum)).map(|(object, _)| *object).collect();
        let all: i128 = self.objects.values().map(|sum| sum.six_volumes).sum();
        if flat.is_empty() && all != 0 {
            return Ok(());
        }
        let names = objects.names();
        let place = |object: &u32| names.get(*object as usize).cloned().unwrap_or_default();
        Err(Error::NotASolid {
            path: path.to_path_buf(),
            what: "the surface has no volume: it bounds no body".into(),
            locations: flat.iter().take(100).map(place).collect(),
            count: flat.len() as u64,
            advice: match objects.count() {
                1 => "give it a thickness, or build cells of its surface with --shell".into(),
                _ => "omit such objects with --skip-bad, select others with --where, or build cells of their surfaces \
                      with --shell"
                    .into(),
            },
        })
    }
}
