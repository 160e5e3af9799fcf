//! Surfaces of a model: the exact one, its part in a box, or a coarse one.

use super::faces_in_box::faces_in_box;
use super::mass::MassSums;
use crate::face_set::FaceSet;
use crate::store::levels::{Cluster, NO_BLOCK};
use crate::{AttributedFaceVisitor, ExactModel, Face, FaceBuffer, Faces, Grid};
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::{Error, Progress, Result};

/// How much detail a surface has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SurfaceDetail {
    /// The exact surface, which needs no levels of detail.
    #[default]
    Exact,
    /// As few faces as possible, whose distance from the exact surface is at most this, in units of
    /// the world. Bodies whose diameter is at most this may be missing.
    Error(f64),
    /// The smallest error for which there are at most this many faces.
    Faces(u64),
    /// A level, from 0, the coarsest.
    Level(u8),
}

/// A surface of a model, with the parts and metadata of the model.
///
/// Coarse surfaces are closed, and near the exact surface. They may intersect themselves, within
/// their error; they are for display. Their faces are triangles without values.
pub struct ModelSurface<'a> {
    model: &'a ExactModel,
    contents: Contents,
    len: u64,
    /// Bound of the distance from the exact surface in grid units.
    error: f64,
}

enum Contents {
    /// All faces of the model.
    All,
    /// Some faces of the model.
    Faces(FaceSet),
    /// Clusters of levels of detail, and their numbers in the file.
    Clusters(Vec<Cluster>, Vec<u64>),
}

/// Number of blocks of coarse faces, or of exact clusters, that are fetched at once from a remote
/// file.
const FETCHED: usize = 64;
/// Number of exact faces that are fetched at once from a remote file.
const FETCHED_FACES: usize = 1 << 14;

impl ExactModel {
    /// Chooses a surface by its detail. In a box of the world, by its minimum and maximum
    /// coordinates, the exact surface has all faces with an area and a point in the box, and some
    /// whose own boxes touch it; another surface has all clusters that touch the box. It is not
    /// closed then. Reads the tables of clusters, 64 bytes per 500 faces; of the exact surface in a
    /// box, nodes and faces there, and holds two bits per face of the model.
    ///
    /// # Errors
    /// If the box is invalid, if the file has no levels or not this one, if it is corrupt or cannot
    /// be read, or on cancellation.
    pub fn surface(
        &self,
        detail: SurfaceDetail,
        within: Option<[[f64; 3]; 2]>,
        progress: &dyn Progress,
    ) -> Result<ModelSurface<'_>> {
        let mut surface = ModelSurface { model: self, contents: Contents::All, len: 0, error: 0.0 };
        if detail == SurfaceDetail::Exact {
            surface.len = Faces::len(self);
            if let Some(within) = within {
                let (faces, len) = faces_in_box(self, within, progress)?;
                (surface.contents, surface.len) = (Contents::Faces(faces), len);
            }
            return Ok(surface);
        }
        let levels = self.count_detail_levels()?;
        let width = self.grid().width();
        let error = match detail {
            SurfaceDetail::Level(level) if usize::from(level) >= levels => {
                let expected = format!("at most {}, the level of the exact surface", levels - 1);
                return Err(Error::invalid("level", level.to_string(), expected));
            }
            SurfaceDetail::Level(_) | SurfaceDetail::Exact => 0.0,
            // (The coarsest clusters are replaced at infinity.)
            SurfaceDetail::Error(error) if error >= 0.0 => (error / width).min(f64::from(f32::MAX)),
            SurfaceDetail::Error(error) => {
                return Err(Error::invalid("error", error.to_string(), "0 or more"));
            }
            SurfaceDetail::Faces(most) => self.error_for(most)?,
        };
        let within = within.map(|corners| corners.map(|corner| self.grid().to_grid(corner)));
        let touches = |[low, high]: &[[i32; 3]; 2]| {
            within.is_none_or(|[min, max]| {
                (0..3).all(|axis| f64::from(low[axis]) <= max[axis] && f64::from(high[axis]) >= min[axis])
            })
        };
        // The surface for an error is nowhere finer than a level whose error is not larger.
        let finest = match detail {
            SurfaceDetail::Level(level) => level.into(),
            _ => self.levels().iter().position(|level| level.error <= error).unwrap_or(levels - 1),
        };
        let mut surface = ModelSurface::without_clusters(self);
        self.each_distinct_cluster(finest, &mut |number, cluster| {
            let is_in = match detail {
                SurfaceDetail::Level(level) => cluster.is_in_level(level),
                _ => cluster.is_in_cut(error),
            };
            if is_in && touches(&cluster.bounds) {
                surface.push(number, cluster);
            }
            Ok(())
        })?;
        Ok(surface)
    }

    /// Visits faces by their numbers, many of which are fetched at once from a remote file.
    pub(super) fn each_numbered(
        &self,
        mut numbers: impl Iterator<Item = u32>,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let mut buffer = FaceBuffer::default();
        loop {
            let next: Vec<usize> =
                numbers.by_ref().take(FETCHED_FACES).map(|number| number as usize).collect();
            if next.is_empty() {
                return Ok(());
            }
            self.fetch(next.iter().copied(), &|number| self.block_of(number as u64).map(drop))?;
            for number in next {
                self.face(number as u64, &mut buffer)?;
                each(&buffer.face())?;
            }
        }
    }
}

impl<'a> ModelSurface<'a> {
    /// A surface of clusters, without any.
    pub(super) fn without_clusters(model: &'a ExactModel) -> ModelSurface<'a> {
        ModelSurface { model, contents: Contents::Clusters(Vec::new(), Vec::new()), len: 0, error: 0.0 }
    }

    /// Adds a cluster to a surface of clusters.
    pub(super) fn push(&mut self, number: u64, cluster: &Cluster) {
        if let Contents::Clusters(clusters, numbers) = &mut self.contents {
            self.len += self.model.faces_of(cluster);
            self.error = self.error.max(cluster.error.into());
            numbers.push(number);
            clusters.push(cluster.clone());
        }
    }

    /// Returns the clusters, and their numbers in the file.
    fn clusters_and_numbers(&self) -> (&[Cluster], &[u64]) {
        match &self.contents {
            Contents::Clusters(clusters, numbers) => (clusters, numbers),
            Contents::All | Contents::Faces(_) => (&[], &[]),
        }
    }

    /// Returns the numbers of the clusters in the file, for [`ExactModel::of_clusters`]; of the
    /// exact surface without levels of detail, none.
    pub fn numbers(&self) -> &[u64] {
        self.clusters_and_numbers().1
    }

    /// Returns each cluster as a surface of its own, in the order of their numbers. Fetches the
    /// faces of all clusters, if the file is remote.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn by_cluster(&self) -> Result<Vec<ModelSurface<'a>>> {
        let (clusters, numbers) = self.clusters_and_numbers();
        self.model.fetch(0..clusters.len(), &|index| {
            let (cluster, mut is_unread) = (&clusters[index], false);
            if cluster.block != NO_BLOCK {
                defer_missing(self.model.level_block(cluster.block as usize), &mut is_unread)?;
            }
            if self.model.is_exact(cluster) {
                defer_missing(self.model.read_on_curve(&cluster.keys), &mut is_unread)?;
            }
            finish_deferred(is_unread)
        })?;
        let alone = |(number, cluster): (&u64, &Cluster)| {
            let mut surface = ModelSurface::without_clusters(self.model);
            surface.push(*number, cluster);
            surface
        };
        Ok(numbers.iter().zip(clusters).map(alone).collect())
    }

    /// Returns a bound of the distance between this surface and the exact one in units of the
    /// world, both ways, except for bodies that are missing: their diameter is at most this.
    pub fn error(&self) -> f64 {
        self.error * self.model.grid().width()
    }

    /// Returns the bound in grid units.
    pub(crate) fn grid_error(&self) -> f64 {
        self.error
    }

    /// Returns the number of clusters.
    pub(crate) fn clusters(&self) -> usize {
        self.clusters_and_numbers().0.len()
    }

    /// Returns whether all faces are those of the exact surface.
    pub fn is_exact(&self) -> bool {
        self.clusters_and_numbers().0.iter().all(|cluster| self.model.is_exact(cluster))
    }

    /// Returns the numbers in the model of the faces, in their order, if these are some faces of
    /// the model. (The numbers of all faces are those of the model.)
    pub fn numbers_of_faces(&self) -> Option<impl Iterator<Item = u32>> {
        match &self.contents {
            Contents::Faces(faces) => Some(faces.numbers()),
            Contents::All | Contents::Clusters(..) => None,
        }
    }

    /// Visits the faces of clusters: first those of blocks of coarse faces, then exact ones.
    fn each_of_clusters(
        &self,
        clusters: &[Cluster],
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let (model, mut buffer) = (self.model, FaceBuffer::default());
        let blocks = clusters.chunk_by(|a, b| a.block == b.block);
        let blocks: Vec<&[Cluster]> = blocks.filter(|same| same[0].block != NO_BLOCK).collect();
        for (index, same) in blocks.iter().enumerate() {
            if index % FETCHED == 0 {
                let next = blocks[index..].iter().take(FETCHED).map(|same| same[0].block as usize);
                model.fetch(next, &|block| model.level_block(block).map(drop))?;
            }
            let block = model.level_block(same[0].block as usize)?;
            for cluster in *same {
                let faces = match model.is_exact(cluster) {
                    true => 0..cluster.first,
                    false => cluster.first..cluster.first.saturating_add(cluster.faces),
                };
                if faces.end as usize > block.len() {
                    let expected = format!("faces of a block of {}", block.len());
                    return Err(model.wrong_cluster(cluster, &expected));
                }
                for face in faces {
                    block.read(face as usize, &mut buffer);
                    each(&buffer.face())?;
                }
            }
        }
        let exact: Vec<&Cluster> = clusters.iter().filter(|cluster| model.is_exact(cluster)).collect();
        for fetched in exact.chunks(FETCHED) {
            model.fetch(0..fetched.len(), &|index| model.read_on_curve(&fetched[index].keys))?;
            let root = model.root()?;
            for contiguous in fetched.chunk_by(|a, b| a.keys.end == b.keys.start) {
                let keys = contiguous[0].keys.start..contiguous[contiguous.len() - 1].keys.end;
                model.each_on_curve(&keys, &root, &mut buffer, each)?;
            }
        }
        Ok(())
    }
}

impl Faces for ModelSurface<'_> {
    fn grid(&self) -> &Grid {
        self.model.grid()
    }

    fn parts(&self) -> &[String] {
        self.model.parts()
    }

    fn origin(&self) -> Option<&dyn Faces> {
        Some(self.model)
    }

    fn value_columns(&self) -> Result<Vec<String>> {
        match &self.contents {
            Contents::All | Contents::Faces(_) => self.model.value_columns(),
            Contents::Clusters(..) => Ok(Vec::new()),
        }
    }

    fn volume_correction(&self) -> Result<f64> {
        match &self.contents {
            Contents::All => self.model.volume_correction(),
            Contents::Faces(_) | Contents::Clusters(..) => Ok(0.0),
        }
    }

    fn mass_sums(&self, progress: &dyn Progress) -> Result<Option<MassSums>> {
        match &self.contents {
            Contents::All => self.model.mass_sums(progress),
            Contents::Faces(_) | Contents::Clusters(..) => Ok(None),
        }
    }

    fn len(&self) -> u64 {
        self.len
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        self.each_with_values(&[], &mut |face, _| each(face))
    }

    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        let mut number = 0;
        let mut next = || {
            number += 1;
            number - 1
        };
        match &self.contents {
            Contents::All => self.model.each_with_values(columns, each),
            Contents::Faces(faces) => {
                let mut values = self.model.values_of(columns)?;
                self.model.each_numbered(faces.numbers(), &mut |face| {
                    each(&Face { number: next(), ..*face }, values.of(face.number)?)
                })
            }
            Contents::Clusters(clusters, _) => {
                let none = vec![None; columns.len()];
                self.each_of_clusters(clusters, &mut |face| each(&Face { number: next(), ..*face }, &none))
            }
        }
    }
}
