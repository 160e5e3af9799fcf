//! Repair of a surface that does not fit into memory. Most faces of a large surface meet no other
//! face. They are streamed from a temporary file. Only the others, and the faces near them, are
//! arranged in memory.
//!
//! 1. A sweep finds the faces that meet others ([`touching`]). These and all faces within the reach
//!    of rounding are arranged; the rest is not.
//! 2. The edges are sorted externally ([`EdgeFaces`]). They connect components, of which some are
//!    reversed ([`turned`]), and patches: components of faces that meet no other face.
//! 3. All faces of a patch have the same winding numbers on both sides. A sample decides for each
//!    patch with faces in the rest ([`Patches`]).
//! 4. The arrangement needs winding numbers at samples of its own, which include the rest
//!    ([`Changes`]).
//! 5. New vertices are snapped, and the region is stitched to the patches that stay, as in
//!    [`combine`](crate::combine()).

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::components::{each_batch, turned};
use super::edges::EdgeFaces;
use super::rays::{Changes, cast};
use super::slabs::{Touching, too_large, touching};
use super::spool::FaceSpool;
use super::{
    InsideRule, MAX_CONTACTS, MAX_CONTACTS_OF_A_FACE, REPAIR_PASSES, Repair, nothing_inside, refuse_flaw,
    refuse_losses, repair_bytes, six_volumes, warn_of_changes,
};
use crate::arrangement::{
    ExactFaces, Operands, RegionFate, Resolved, Rounded, SamplePoint, Seams, Surroundings, Turned, Turner,
    divide, round,
};
use crate::boxes::{BOX, Bounds, BoxTree, bounds_of};
use crate::closure::SurfaceClosure;
use crate::exact::union_find::UnionFind;
use crate::face_set::FaceSet;
use crate::{ColumnValues, Face, FaceList, Faces, ModelBuilder};
use spinney_base::{Progress, Result, SilentProgress, SubProgress};

/// Distance in grid units within which faces are arranged together with those that meet others.
/// Rounding and mending move vertices by at most 10 units.
const NEAR: i32 = 12;

/// Repairs a closed surface as [`repair`](super::repair) does, within the memory.
pub(super) fn repair_in_regions(
    faces: &FaceSpool,
    rule: InsideRule,
    builder: ModelBuilder,
    path: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<(ModelBuilder, Repair)> {
    let part = || SubProgress::new(progress, faces.len, REPAIR_PASSES * faces.len);
    let silent = &SilentProgress(progress);
    // (The numbers of components or patches, and sets of faces.)
    let needed = faces.len * 5;
    if needed > memory / 2 {
        return Err(too_large(path, "the components of the surface to repair", 2 * needed, memory));
    }
    let most = MAX_CONTACTS_OF_A_FACE * faces.len + MAX_CONTACTS;
    let Touching { set: touching, pairs } = touching(faces, most, path, memory, &part())?;
    let edges = EdgeFaces::of(faces, memory / 4, silent)?;
    let (is_turned, turned) = turned(faces, &edges, &pairs, memory / 16, silent)?;
    progress_of(&part(), faces.len);
    let pair_count = pairs.len() as u64;
    drop(pairs);
    let in_region = Region::find(faces, &touching, path, memory, silent)?;
    let mut patches = Patches::of(faces, &edges, touching, progress)?;
    drop(edges);
    patches.decide(faces, (&in_region, &is_turned), rule, memory / 16, silent)?;
    progress_of(&part(), faces.len);
    let task = Task { faces, in_region, is_turned, patches, rule, path, memory, progress };
    task.repaired(builder, pair_count, turned)
}

/// Reports work on all faces that has no progress of its own.
fn progress_of(part: &dyn Progress, faces: u64) {
    part.advance(faces, faces);
}

/// The faces that are arranged.
struct Region {
    list: FaceList,
    values: BTreeMap<u64, ColumnValues>,
}

impl Region {
    /// Finds the faces that meet others or are near such faces.
    fn find(
        faces: &FaceSpool,
        touching: &FaceSet,
        path: &Path,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<FaceSet> {
        let mut boxes: Vec<(u32, Bounds)> = Vec::new();
        faces.each(progress, &mut |face, _| {
            if touching.has(face.number) {
                boxes.push((face.number as u32, bounds_of(face.points, NEAR)));
                let bytes = (boxes.len() * (size_of::<(u32, Bounds)>() + BOX)) as u64;
                if bytes > memory / 2 {
                    return Err(too_large(path, "the boxes of the faces that meet", 2 * bytes, memory));
                }
            }
            Ok(())
        })?;
        let tree = BoxTree::watched(&boxes, progress)?;
        drop(boxes);
        let mut found = FaceSet::new(faces.len);
        faces.each(progress, &mut |face, _| {
            let own = bounds_of(face.points, 0);
            found.set(face.number, tree.touches(&own) && face.has_area());
            Ok(())
        })?;
        Ok(found)
    }
}

/// Components of the faces that meet no other, connected by edges that exactly two faces share.
struct Patches {
    sets: UnionFind,
    touching: FaceSet,
    /// Fate of each patch with faces in the rest, by its first face: by the rule, and by that of
    /// cells.
    fates: HashMap<u32, [RegionFate; 2]>,
}

impl Patches {
    fn of(
        faces: &FaceSpool,
        edges: &EdgeFaces,
        touching: FaceSet,
        progress: &dyn Progress,
    ) -> Result<Patches> {
        let mut sets = UnionFind::new(faces.len as usize);
        // Invariant: that of `Surface::components`, which holds for the same reason.
        edges.each(progress, &mut |faces| {
            if let [one, other] = faces
                && !touching.has((*one).into())
                && !touching.has((*other).into())
            {
                sets.join(*one, *other);
            }
            Ok(())
        })?;
        Ok(Patches { sets, touching, fates: HashMap::new() })
    }

    /// Decides the fates of all patches with faces outside of the region.
    fn decide(
        &mut self,
        faces: &FaceSpool,
        (in_region, is_turned): (&FaceSet, &FaceSet),
        rule: InsideRule,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<()> {
        let Patches { sets, touching, fates } = self;
        let mut seen = FaceSet::new(faces.len);
        let mut chosen = FaceSet::new(faces.len);
        faces.each(progress, &mut |face, _| {
            let number = face.number;
            if !in_region.has(number) && !touching.has(number) && face.has_area() {
                let root = sets.root(number as u32).into();
                chosen.set(number, !seen.has(root));
                seen.set(root, true);
            }
            Ok(())
        })?;
        drop(seen);
        each_batch(
            faces,
            memory,
            progress,
            &mut |face| chosen.has(face.into()).then_some(face),
            &mut |samples, numbers| {
                // Above, change at the sample, and orientation of the sample's own face.
                let mut windings = vec![(0, 0, 0); samples.len()];
                cast(faces, samples, progress, &mut |hit| {
                    let weight = if is_turned.has(hit.face.into()) { -hit.up } else { hit.up };
                    let (above, change, up) = &mut windings[hit.sample as usize];
                    *if hit.is_at { change } else { above } += weight;
                    if numbers[hit.sample as usize] == hit.face {
                        *up = hit.up;
                    }
                })?;
                for (number, (above, change, up)) in numbers.iter().zip(windings) {
                    let fate = |rule: InsideRule| {
                        let [above, below] = [above, above + change].map(|winding| rule.is_inside(winding));
                        RegionFate::of_single(up > 0, above, below)
                    };
                    fates.insert(sets.root(*number), [fate(rule), fate(InsideRule::Nonzero)]);
                }
                Ok(())
            },
        )
    }

    /// Returns the fates of a face outside of the region; `None` if it has no area, and no face
    /// with an area is in its patch.
    fn of_face(&mut self, number: u32) -> Option<[RegionFate; 2]> {
        self.fates.get(&self.sets.root(number)).copied()
    }
}

/// How often a face with this fate counts in the result.
fn weight(fate: RegionFate) -> i32 {
    match fate {
        RegionFate::Stays { is_turned: false, .. } => 1,
        RegionFate::Stays { is_turned: true, .. } => -1,
        _ => 0,
    }
}

/// Counts of the faces outside of the region, and their sums.
#[derive(Default)]
struct Rest {
    removed: u64,
    outside: u64,
    outside_area: f64,
    /// Area of all faces, also of those in the region.
    area: f64,
    region_area: f64,
    /// Six times the volumes by the rule, and by that of cells.
    volumes: [i128; 2],
    kept: u64,
}

/// A surface whose patches are decided.
struct Task<'a> {
    faces: &'a FaceSpool,
    in_region: FaceSet,
    is_turned: FaceSet,
    patches: Patches,
    rule: InsideRule,
    path: &'a Path,
    memory: u64,
    progress: &'a dyn Progress,
}

impl Task<'_> {
    fn repaired(
        mut self,
        builder: ModelBuilder,
        pairs: u64,
        turned: Turned,
    ) -> Result<(ModelBuilder, Repair)> {
        let Task { faces, path, memory, rule, progress, .. } = self;
        let width = faces.grid.width();
        let part = || SubProgress::new(progress, faces.len, REPAIR_PASSES * faces.len);
        let mut seams = Seams::default();
        let (region, rest) = self.region(&mut seams)?;
        let region_faces = ExactFaces::of_grid(region.list);
        // (Both rules have the same samples.)
        let mut changes = Changes::new(memory / 16);
        let (exact, done) = self.divided(&region_faces, rule, &mut changes)?;
        if exact.list.is_empty() && rest.kept == 0 {
            return Err(nothing_inside(rule, path));
        }
        let cube = width.powi(3);
        let volume = six_volumes(&exact, rest.volumes[0]) / 6.0;
        let cells_volume = match rule {
            InsideRule::Nonzero => volume,
            _ => {
                let (exact, _) = self.divided(&region_faces, InsideRule::Nonzero, &mut changes)?;
                six_volumes(&exact, rest.volumes[1]) / 6.0
            }
        };
        drop((region_faces, changes));
        let outside_area = rest.outside_area + done.outside_share * rest.region_area;
        let outside_share = if outside_area == 0.0 { 0.0 } else { outside_area / rest.area };
        let outside = done.outside + rest.outside;
        refuse_losses(
            rule,
            (outside, faces.len),
            outside_share,
            [volume, cells_volume].map(|volume| volume * cube),
            path,
        )?;
        warn_of_changes(outside_share, volume / cells_volume, path, progress);
        progress_of(&part(), faces.len);
        let rounded = self.rounded(exact, seams)?;
        let repaired = Repair {
            faces: faces.len,
            turned: (turned.roots, turned.faces),
            pairs,
            divided: done.divided,
            removed: done.removed + rest.removed,
            outside,
            outside_share,
            volume_before: turned.volume * cube,
            volume: volume * cube,
            cells_volume: cells_volume * cube,
            displacement: rounded.displacement * width,
        };
        let mut builder = builder.values_by_source(region.values.clone());
        let mut surface = SurfaceClosure::new(!rounded.exact.is_empty());
        self.each_kept(&part(), &mut |face, values| {
            surface.add(face, false);
            builder.push(face)?;
            // (The builder adds the values of sources that it knows.)
            if region.values.contains_key(&face.source) {
                return Ok(());
            }
            values.iter().try_for_each(|(column, json)| builder.face_value(column, json))
        })?;
        rounded.faces.each(&mut |face| {
            surface.add(face, rounded.is_proxy[face.number as usize]);
            Ok(())
        })?;
        rounded.exact.iter().try_for_each(|face| surface.add_exact(face, progress))?;
        refuse_flaw(surface, path)?;
        Ok((builder.push_rounded(rounded, &SilentProgress(progress))?, repaired))
    }

    /// Returns the faces of the region, oriented as their components, and counts the rest. Watches
    /// the edges at which the rest may be open.
    fn region(&mut self, seams: &mut Seams) -> Result<(Region, Rest)> {
        let Task { faces, in_region, is_turned, patches, path, memory, progress, .. } = self;
        let mut region =
            Region { list: FaceList::new(faces.grid.clone(), Vec::new()), values: BTreeMap::new() };
        let (mut rest, mut turner, mut border) = (Rest::default(), Turner::default(), Seams::default());
        let mut value_bytes = 0;
        faces.each(*progress, &mut |face, values| {
            let area = face.area();
            rest.area += area;
            if in_region.has(face.number) {
                rest.region_area += area;
                border.add(face);
                match is_turned.has(face.number) {
                    true => region.list.push(&turner.turn(face)),
                    false => region.list.push(face),
                }
                if !values.is_empty() && !region.values.contains_key(&face.source) {
                    let of = |(column, json): &(String, String)| (column.len() + json.len() + 64) as u64;
                    value_bytes += values.iter().map(of).sum::<u64>();
                    region.values.insert(face.source, values.clone());
                }
                let needed = repair_bytes(&region.list) + border.bytes() + value_bytes;
                if needed > *memory / 2 {
                    let what = "the faces to repair that meet others or are near such faces";
                    return Err(too_large(path, what, 2 * needed, *memory));
                }
                return Ok(());
            }
            if !face.has_area() {
                // A face without area closes the surface where a vertex of one face is on an edge
                // of another. So other faces may be open at its edges if their fates differ.
                let mut own = Seams::default();
                own.add(face);
                seams.watch(own);
                if seams.bytes() > *memory / 4 {
                    let what = "the edges of the faces without area of the surface to repair";
                    return Err(too_large(path, what, 4 * seams.bytes(), *memory));
                }
            }
            let Some(fates) = patches.of_face(face.number as u32) else { return Ok(()) };
            for (volume, fate) in rest.volumes.iter_mut().zip(fates) {
                *volume += i128::from(weight(fate)) * face.six_volumes();
            }
            match fates[0] {
                RegionFate::Stays { .. } => rest.kept += 1,
                fate if face.has_area() => {
                    rest.removed += 1;
                    if fate == RegionFate::Outside {
                        rest.outside += 1;
                        rest.outside_area += area;
                    }
                }
                _ => {}
            }
            Ok(())
        })?;
        seams.watch(border);
        Ok((region, rest))
    }

    /// Divides the region by a rule. `changes` are the changes of winding numbers by the rest.
    fn divided(
        &self,
        region: &ExactFaces,
        rule: InsideRule,
        changes: &mut Changes,
    ) -> Result<(ExactFaces, Resolved)> {
        let Task { faces, in_region, is_turned, path, memory, progress, .. } = self;
        let weight = |face: u32| match face.into() {
            face if in_region.has(face) => 0,
            face if is_turned.has(face) => -1,
            _ => 1,
        };
        let silent = SilentProgress(*progress);
        changes.settle(faces, &mut |face| weight(face), &silent, &|changes| {
            let rest = |sample: &SamplePoint<'_>| Ok(changes.above(sample));
            let operands = Operands {
                ends: &[region.list.len() as u32],
                far: &[0],
                most_contacts: MAX_CONTACTS_OF_A_FACE * faces.len + MAX_CONTACTS,
                decides_each: true,
                unites_equal_faces: true,
                rest: Some(&rest),
                is_inside: &|windings| rule.is_inside(windings[0]),
                ..Operands::NONE
            };
            divide(region, &operands, path, *memory / 2, &silent)
        })
    }

    /// Snaps the region's new vertices to the grid, stitches it to the patches that stay, and mends
    /// it.
    fn rounded(&mut self, exact: ExactFaces, mut seams: Seams) -> Result<Rounded> {
        let (path, memory, progress) = (self.path, self.memory / 2, self.progress);
        let silent = SilentProgress(progress);
        let mut rounded = round(exact, progress)?;
        let crossings = rounded.crossings(path, memory, progress)?;
        seams.add_all(&rounded.faces, progress)?;
        self.each_kept(&silent, &mut |face, _| {
            seams.add_watched(face);
            Ok(())
        })?;
        let Task { faces, in_region, patches, .. } = self;
        // (Of the result: patches that stay, oriented as they do.)
        let mut weight = |face: u32| match in_region.has(face.into()) {
            true => 0,
            false => patches.of_face(face).map_or(0, |fates| weight(fates[0])),
        };
        Changes::new(memory / 8).settle(faces, &mut weight, &silent, &|changes| {
            let rest = |sample: &SamplePoint<'_>| Ok(changes.above(sample));
            let around = Surroundings { is_unbounded: false, reach: 1, rest: Some(&rest) };
            let (rounded, seams) = (rounded.clone(), seams.clone());
            rounded.stitch_and_mend(seams, crossings, &around, path, memory, progress)
        })
    }

    /// Passes the faces of the rest that stay, oriented as in the result, with their values.
    fn each_kept(
        &mut self,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&Face<'_>, &ColumnValues) -> Result<()>,
    ) -> Result<()> {
        let Task { faces, in_region, patches, .. } = self;
        let mut turner = Turner::default();
        faces.each(progress, &mut |face, values| {
            if face.number.is_multiple_of(OFTEN) {
                progress.advance(OFTEN.min(faces.len - face.number), faces.len);
            }
            if in_region.has(face.number) {
                return Ok(());
            }
            match patches.of_face(face.number as u32) {
                Some([RegionFate::Stays { is_turned: true, .. }, _]) => each(&turner.turn(face), values),
                Some([RegionFate::Stays { .. }, _]) => each(face, values),
                _ => Ok(()),
            }
        })
    }
}

/// Faces between two reports of progress.
const OFTEN: u64 = 1 << 12;
