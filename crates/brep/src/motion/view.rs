//! Views of models through affine maps, without files of their own.
//!
//! Points, rays, planes and boxes are mapped to the model by the inverse map, and results are
//! mapped back. If a map is a signed permutation of the axes with integer shifts in grid units and
//! a uniform scaling, shift and scaling are stored in the grid. Only signs and the order of
//! coordinates remain to be mapped, so nothing is rounded. Measures that a map does not preserve,
//! such as distances under scaling that depends on the direction, are rejected.

use std::collections::BTreeMap;

use super::lattice::Lattice;
use super::map::Motion;
use super::numbers;
use crate::exact::normal::ring_normal;
use crate::exact::vector::dot;
use crate::query::{
    BoxLocation, CuttingPlane, Hit, Location, MassProperties, ModelRays, PartMeasures, SectionPolygon,
    SectionVisitor, SurfacePoint,
};
use crate::{ContactVisitor, ExactModel, Faces, ObjectContact};
use spinney_base::{Error, Progress, Result};

/// An exact model seen through an affine map: queries return the results of the moved model,
/// without a file of it.
///
/// ```
/// use spinney::ExactModel;
/// use spinney::brep::Motion;
/// use spinney::raw::brep::ModelView;
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// # use spinney::Output;
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = |name: &str| directory.path().join(name);
/// # let text = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
/// # std::fs::write(path("a.off"), text).unwrap();
/// # import_exact(open_all(&[path("a.off")], 64 << 20)?, &ExactOptions::new(), Output::create(&path("a.goblin"))?, &())?;
/// let model = ExactModel::open(&path("a.goblin"), &Default::default())?;
/// let mirror = Motion::from_rows([[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 2.0]])?;
/// let view = ModelView::of(model, &mirror)?;
/// assert!(view.is_exact());
/// assert_eq!(view.signed_distance([-0.25, 0.25, 2.125])?, -0.125);
/// # Ok::<(), spinney::Error>(())
/// ```
pub struct ModelView {
    /// The model, on a grid that includes the exact part of the map.
    model: ExactModel,
    rest: Option<Rest>,
}

/// The remaining map of coordinates.
struct Rest {
    /// The map as given.
    whole: Motion,
    there: Motion,
    back: Motion,
    /// Whether it only permutes and mirrors axes.
    is_exact: bool,
    /// The factor of all lengths; `None` if it depends on the direction.
    factor: Option<f64>,
    /// The factor of volumes.
    volume: f64,
    is_mirrored: bool,
}

/// Measures of mapped faces that do not follow from those of the original faces.
struct Outline {
    /// Twice the area, in squared units of the model's grid.
    area: f64,
    bounds: [[f64; 3]; 2],
}

impl From<ExactModel> for ModelView {
    fn from(model: ExactModel) -> ModelView {
        ModelView { model, rest: None }
    }
}

impl ModelView {
    /// Creates the view of a model after a motion.
    ///
    /// # Errors
    /// If the model is too far from the origin then, or the motion is not invertible in doubles.
    pub fn of(model: ExactModel, motion: &Motion) -> Result<ModelView> {
        if let Some((of_grid, turn)) = motion.split()
            && let Some(lattice) = Lattice::of(&model, &of_grid)?.filter(Lattice::is_only_the_grid)
        {
            let rest = if turn.is_identity() { None } else { Some(Rest::of(motion, turn, true)?) };
            return Ok(ModelView { model: model.on_grid(lattice.grid), rest });
        }
        Ok(ModelView { model, rest: Some(Rest::of(motion, motion.without_noise(), false)?) })
    }

    /// Returns the model, for everything that does not depend on its position: file, parts,
    /// attributes, and topology.
    pub fn file(&self) -> &ExactModel {
        &self.model
    }

    /// Returns the model, if its results are the same as the view's: the view only shifts by
    /// integer numbers of grid units, and scales uniformly. `query` is for the error.
    ///
    /// # Errors
    /// If the view does more than that.
    pub fn as_model(&self, query: &str) -> Result<&ExactModel> {
        match &self.rest {
            None => Ok(&self.model),
            Some(rest) => Err(self.refused(
                rest,
                query,
                "which does more than shift by integer grid units and scale uniformly",
            )),
        }
    }

    /// Returns whether mapping to the model and back rounds nothing.
    pub fn is_exact(&self) -> bool {
        self.rest.as_ref().is_none_or(|rest| rest.is_exact)
    }

    /// Returns an upper bound of the rounding error of positions that are mapped to the model and
    /// back, in units of the view; 0 if nothing is rounded.
    pub fn rounding(&self) -> f64 {
        /// Approximate number of roundings of a mapping to the model and back.
        const ROUNDINGS: f64 = 16.0;
        let Some(rest) = self.rest.as_ref().filter(|rest| !rest.is_exact) else { return 0.0 };
        let (grid, last) = (self.model.grid(), ((1i64 << self.model.grid().bits) - 1) as i32);
        let corners = [[0; 3], [last; 3]].map(|corner| grid.to_world(corner));
        let farthest = corners.as_flattened().iter().fold(0.0, |most: f64, at| most.max(at.abs()));
        let shift = rest.there.shift().into_iter().fold(0.0, |most: f64, at| most.max(at.abs()));
        let reach = rest.there.growth() * farthest + shift;
        ROUNDINGS * f64::EPSILON * rest.there.growth() * rest.back.growth() * reach
    }

    fn refused(&self, rest: &Rest, query: &str, why: &str) -> Error {
        let rows = rest.whole.to_rows();
        let found = format!("{query} through the view affine={}, {why}", numbers(rows.as_flattened(), ","));
        Error::unsupported(
            self.model.path(),
            found,
            "write the view to a file with `spinney transform`, and query that file",
        )
    }

    /// Returns the factor of lengths, if it is uniform.
    fn factor(&self, rest: &Rest, query: &str) -> Result<f64> {
        let why = "which does not scale all directions equally";
        rest.factor.ok_or_else(|| self.refused(rest, query, why))
    }

    /// See [`ExactModel::locate`].
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn locate(&self, point: [f64; 3]) -> Result<Location> {
        self.model.locate(self.carried(point))
    }

    /// See [`ExactModel::locate_all`].
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn locate_all(&self, points: &[[f64; 3]], locations: &mut Vec<Location>) -> Result<()> {
        match &self.rest {
            None => self.model.locate_all(points, locations),
            Some(rest) => {
                let points: Vec<[f64; 3]> = points.iter().map(|point| rest.back.apply(*point)).collect();
                self.model.locate_all(&points, locations)
            }
        }
    }

    /// Maps a point of the view to the model.
    fn carried(&self, point: [f64; 3]) -> [f64; 3] {
        self.rest.as_ref().map_or(point, |rest| rest.back.apply(point))
    }

    /// See [`ExactModel::nearest`].
    ///
    /// # Errors
    /// If the view scales differently along directions, or the file is corrupt or cannot be read.
    pub fn nearest(&self, to: [f64; 3]) -> Result<Option<SurfacePoint>> {
        let Some(rest) = &self.rest else { return self.model.nearest(to) };
        let factor = self.factor(rest, "distances")?;
        let found = self.model.nearest(rest.back.apply(to))?;
        Ok(found.map(|found| SurfacePoint {
            point: rest.there.apply(found.point),
            distance: factor * found.distance,
            ..found
        }))
    }

    /// See [`ExactModel::signed_distance`].
    ///
    /// # Errors
    /// The errors of [`ModelView::nearest`].
    pub fn signed_distance(&self, from: [f64; 3]) -> Result<f64> {
        let Some(rest) = &self.rest else { return self.model.signed_distance(from) };
        let factor = self.factor(rest, "distances")?;
        Ok(factor * self.model.signed_distance(rest.back.apply(from))?)
    }

    /// See [`ExactModel::ray_crossings`].
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn ray_crossings(&self, from: [f64; 3], direction: [f64; 3]) -> Result<Vec<Hit>> {
        let Some(rest) = &self.rest else { return self.model.ray_crossings(from, direction) };
        let [from, direction] = rest.ray([from, direction]);
        let found = self.model.ray_crossings(from, direction)?;
        Ok(found.into_iter().map(|hit| rest.hit(hit)).collect())
    }

    /// Returns a caster of many rays: see [`ExactModel::rays`].
    pub fn rays(&self) -> ViewRays<'_> {
        ViewRays { rest: self.rest.as_ref(), rays: self.model.rays() }
    }

    /// See [`ExactModel::locate_box`].
    ///
    /// # Errors
    /// If the sides of the box are not along the model's axes, or as [`ExactModel::locate_box`].
    pub fn locate_box(&self, min: [f64; 3], max: [f64; 3]) -> Result<BoxLocation> {
        let is_box = (0..3).all(|axis| min[axis] <= max[axis]);
        // (Invalid boxes are rejected by the model.)
        let Some(rest) = self.rest.as_ref().filter(|_| is_box) else {
            return Ok(self.model.locate_box(min, max)?.0);
        };
        if !rest.keeps_axes() {
            return Err(self.refused(
                rest,
                "boxes",
                "which turns the model's axes by other than quarter turns",
            ));
        }
        let [min, max] = around([min, max].map(|corner| rest.back.apply(corner)));
        Ok(self.model.locate_box(min, max)?.0)
    }

    /// See [`ExactModel::bounds`]. (If the view rotates by other than quarter turns, all faces are
    /// read.)
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn bounds(&self) -> Result<[[f64; 3]; 2]> {
        match &self.rest {
            Some(rest) if !rest.keeps_axes() => {
                let outline = self.outlines(rest, false, &())?.into_values().next();
                Ok(outline.map_or([[0.0; 3]; 2], |outline| outline.bounds))
            }
            Some(rest) => Ok(around(self.model.bounds()?.map(|corner| rest.there.apply(corner)))),
            None => self.model.bounds(),
        }
    }

    /// See [`MassProperties::of`].
    ///
    /// # Errors
    /// If the faces cannot be read, or on cancellation.
    pub fn mass(&self, progress: &dyn Progress) -> Result<MassProperties> {
        let measures = MassProperties::of(&self.model, progress)?;
        let Some(rest) = &self.rest else { return Ok(measures) };
        let outline = match rest.needs_outlines() {
            true => self.outlines(rest, false, progress)?.into_values().next(),
            false => None,
        };
        Ok(rest.measures(measures, outline, self.model.grid().width()))
    }

    /// See [`ExactModel::part_measures`].
    ///
    /// # Errors
    /// The errors of [`ExactModel::part_measures`].
    pub fn part_measures(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<PartMeasures>> {
        let all = self.model.part_measures(memory, progress)?;
        let Some(rest) = &self.rest else { return Ok(all) };
        let mut outlines = match rest.needs_outlines() {
            true => self.outlines(rest, true, progress)?,
            false => BTreeMap::new(),
        };
        let width = self.model.grid().width();
        let carried = all.into_iter().map(|own| PartMeasures {
            measures: rest.measures(own.measures, outlines.remove(&own.part), width),
            ..own
        });
        Ok(carried.collect())
    }

    /// Returns the areas and bounding boxes of the mapped faces: of each part, or of all.
    fn outlines(
        &self,
        rest: &Rest,
        by_part: bool,
        progress: &dyn Progress,
    ) -> Result<BTreeMap<u32, Outline>> {
        let grid = self.model.grid();
        let mut found: BTreeMap<u32, Outline> = BTreeMap::new();
        self.model.each(&mut |face| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            let nothing = || Outline { area: 0.0, bounds: [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]] };
            let outline = found.entry(if by_part { face.part } else { 0 }).or_insert_with(nothing);
            let mut normal = [0.0; 3];
            for ring in face.rings() {
                let own = ring_normal(ring);
                (0..3).for_each(|axis| normal[axis] += own[axis] as f64);
            }
            outline.area += rest.area_of(normal);
            let [low, high] = &mut outline.bounds;
            for point in face.points {
                let at = rest.there.apply(grid.to_world(*point));
                for axis in 0..3 {
                    low[axis] = low[axis].min(at[axis]);
                    high[axis] = high[axis].max(at[axis]);
                }
            }
            Ok(())
        })?;
        Ok(found)
    }

    /// See [`ExactModel::section`].
    ///
    /// # Errors
    /// The errors of [`ExactModel::section`].
    pub fn section(&self, plane: &CuttingPlane, progress: &dyn Progress) -> Result<Vec<SectionPolygon>> {
        let Some(rest) = &self.rest else { return self.model.section(plane, progress) };
        let own = CuttingPlane {
            normal: rest.normal(plane.normal),
            distance: plane.distance - dot(plane.normal, rest.there.shift()),
        };
        let found = self.model.section(&own, progress)?;
        Ok(rest.polygons(&found, own.normal))
    }

    /// See [`ExactModel::plane_sections`].
    ///
    /// # Errors
    /// The errors of [`ExactModel::plane_sections`].
    pub fn plane_sections(
        &self,
        normal: [f64; 3],
        distances: &mut dyn ExactSizeIterator<Item = f64>,
        by_part: bool,
        progress: &dyn Progress,
        each: &mut SectionVisitor<'_>,
    ) -> Result<()> {
        let Some(rest) = &self.rest else {
            return self.model.plane_sections(normal, distances, by_part, progress, each);
        };
        let own = rest.normal(normal);
        let shift = dot(normal, rest.there.shift());
        let mut distances = distances.map(|distance| distance - shift);
        self.model.plane_sections(own, &mut distances, by_part, progress, &mut |number, polygons| {
            each(number, &rest.polygons(polygons, own))
        })
    }

    /// See [`ExactModel::object_contacts`].
    ///
    /// # Errors
    /// If the view scales differently along directions, or as [`ExactModel::object_contacts`].
    pub fn object_contacts(
        &self,
        memory: u64,
        progress: &dyn Progress,
        each: &mut ContactVisitor<'_>,
    ) -> Result<Vec<u32>> {
        let Some(rest) = &self.rest else { return self.model.object_contacts(memory, progress, each) };
        let factor = self.factor(rest, "areas of shared walls of objects")?;
        self.model.object_contacts(memory, progress, &mut |contact| {
            each(&ObjectContact {
                volume: contact.volume * rest.volume,
                area: contact.area * factor * factor,
                place: rest.there.apply(contact.place),
                ..*contact
            })
        })
    }

    /// Returns the factor between volumes in the view and in the model.
    pub fn volume_factor(&self) -> f64 {
        self.rest.as_ref().map_or(1.0, |rest| rest.volume)
    }
}

/// Casts rays through a view, from one thread at a time: see [`ModelRays`].
pub struct ViewRays<'a> {
    rest: Option<&'a Rest>,
    rays: ModelRays<'a>,
}

impl ViewRays<'_> {
    /// See [`ModelRays::first`].
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn first(&mut self, from: [f64; 3], direction: [f64; 3]) -> Result<Option<Hit>> {
        let Some(rest) = self.rest else { return self.rays.first(from, direction) };
        let [from, direction] = rest.ray([from, direction]);
        Ok(self.rays.first(from, direction)?.map(|hit| rest.hit(hit)))
    }

    /// See [`ModelRays::first_of`].
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn first_of(&mut self, rays: &[[[f64; 3]; 2]]) -> Result<Vec<Option<Hit>>> {
        let Some(rest) = self.rest else { return self.rays.first_of(rays) };
        let rays: Vec<[[f64; 3]; 2]> = rays.iter().map(|ray| rest.ray(*ray)).collect();
        let found = self.rays.first_of(&rays)?;
        Ok(found.into_iter().map(|hit| hit.map(|hit| rest.hit(hit))).collect())
    }
}

impl Rest {
    fn of(whole: &Motion, there: Motion, is_exact: bool) -> Result<Rest> {
        Ok(Rest {
            whole: whole.clone(),
            back: there.inverse()?,
            is_exact,
            factor: there.factor(),
            volume: there.volume_factor(),
            is_mirrored: there.is_mirrored(),
            there,
        })
    }

    /// Returns whether axis-aligned boxes stay axis-aligned.
    fn keeps_axes(&self) -> bool {
        let is_axis = |row: &[f64; 4]| row[..3].iter().filter(|number| **number != 0.0).count() == 1;
        self.there.to_rows().iter().all(is_axis)
    }

    /// Returns whether areas or bounding boxes require reading the faces.
    fn needs_outlines(&self) -> bool {
        self.factor.is_none() || !self.keeps_axes()
    }

    /// Maps a ray of the view to the model.
    fn ray(&self, [from, direction]: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
        [self.back.apply(from), self.back.turn(direction)]
    }

    fn hit(&self, hit: Hit) -> Hit {
        Hit { point: self.there.apply(hit.point), ..hit }
    }

    /// Maps the normal of planes in the view to the model; products with points are the same,
    /// except for the shift.
    fn normal(&self, normal: [f64; 3]) -> [f64; 3] {
        self.there.turn_transposed(normal)
    }

    /// Returns the length of a mapped area vector.
    fn area_of(&self, normal: [f64; 3]) -> f64 {
        let there = self.back.turn_transposed(normal);
        self.volume * dot(there, there).sqrt()
    }

    /// Maps polygons in planes with a normal to the view.
    fn polygons(&self, found: &[SectionPolygon], normal: [f64; 3]) -> Vec<SectionPolygon> {
        let share = match self.is_exact {
            true => 1.0,
            false => self.area_of(normal) / dot(normal, normal).sqrt(),
        };
        let ring = |ring: &Vec<[f64; 3]>| {
            let mut ring: Vec<[f64; 3]> = ring.iter().map(|point| self.there.apply(*point)).collect();
            if self.is_mirrored {
                ring.reverse();
            }
            ring
        };
        let carried = found.iter().map(|polygon| SectionPolygon {
            rings: polygon.rings.iter().map(ring).collect(),
            area: polygon.area * share,
            part: polygon.part,
        });
        carried.collect()
    }

    /// Maps measures; `width` is that of the model's grid unit.
    fn measures(&self, own: MassProperties, outline: Option<Outline>, width: f64) -> MassProperties {
        let moments = |own: &[[f64; 3]; 3]| self.there.tensor(own).map(|row| row.map(|at| at * self.volume));
        let second_moments = moments(&own.second_moments);
        let trace = second_moments[0][0] + second_moments[1][1] + second_moments[2][2];
        let of_second = |i: usize, j: usize| {
            if i == j { trace - second_moments[i][j] } else { -second_moments[i][j] }
        };
        let inertia = match self.factor {
            // (For maps that preserve angles, inertia is mapped like the moments.)
            Some(_) => moments(&own.inertia),
            None => [0, 1, 2].map(|i| [0, 1, 2].map(|j| of_second(i, j))),
        };
        let area = match (self.factor, &outline) {
            (Some(factor), _) => own.area * factor * factor,
            (None, Some(outline)) => outline.area / 2.0 * width * width,
            (None, None) => own.area,
        };
        let bounds = match outline {
            Some(outline) => Some(outline.bounds),
            None => own.bounds.map(|bounds| around(bounds.map(|corner| self.there.apply(corner)))),
        };
        MassProperties {
            volume: own.volume * self.volume,
            centre: own.centre.map(|centre| self.there.apply(centre)),
            second_moments,
            inertia,
            area,
            bounds,
            ..own
        }
    }
}

/// Returns the box of two opposite corners.
fn around([a, b]: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
    [[0, 1, 2].map(|axis| a[axis].min(b[axis])), [0, 1, 2].map(|axis| a[axis].max(b[axis]))]
}
