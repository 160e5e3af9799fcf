//! Components of a surface that need not fit into memory: which are reversed first.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use super::edges::EdgeFaces;
use super::rays::cast;
use super::spool::FaceSpool;
use crate::arrangement::{SAMPLES, StoredSample, SurfaceComponents, Turned, root_components, sample_of_face};
use crate::face_set::FaceSet;
use spinney_base::{Progress, Result};

/// Returns the faces of the components that are reversed first: the outermost ones that are inside
/// out, with all components inside. `pairs` are the pairs of faces that meet. Samples take about
/// `memory` bytes.
///
/// # Errors
/// If temporary files cannot be read, or on cancellation.
pub(super) fn turned(
    faces: &FaceSpool,
    edges: &EdgeFaces,
    pairs: &[[u32; 2]],
    memory: u64,
    progress: &dyn Progress,
) -> Result<(FaceSet, Turned)> {
    let mut components = SurfaceComponents::of(faces.len, &|each| edges.each(progress, each), &|each| {
        faces.each(progress, &mut |face, _| each(face.number as u32, face))
    })?;
    let none = FaceSet::new(faces.len);
    if components.are_upright() {
        return Ok((none, Turned { volume: components.volume(|_| false), ..Turned::default() }));
    }
    let SurfaceComponents { of_face, list } = &mut components;
    let mut touched: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for [a, b] in pairs.iter().map(|pair| pair.map(|face| of_face.root(face))).filter(|[a, b]| a != b) {
        touched.entry(a).or_default().insert(b);
        touched.entry(b).or_default().insert(a);
    }
    let touch = |a: u32, b: u32| touched.get(&a).is_some_and(|others| others.contains(&b));
    let mut around_of: BTreeMap<u32, Vec<u32>> = list.keys().map(|number| (*number, Vec::new())).collect();
    // One sample decides which components without contacts are around a component.
    let firsts: HashMap<u32, u32> =
        list.iter().filter_map(|(number, component)| Some((component.first?, *number))).collect();
    each_batch(faces, memory, progress, &mut |face| firsts.get(&face).copied(), &mut |samples, owners| {
        let mut windings: BTreeMap<(u32, u32), i32> = BTreeMap::new();
        cast(faces, samples, progress, &mut |hit| {
            let key = (hit.sample, of_face.root(hit.face));
            *windings.entry(key).or_default() += if hit.is_at { 0 } else { hit.up };
        })?;
        for ((sample, other), _) in windings.into_iter().filter(|(_, winding)| *winding != 0) {
            let own = owners[sample as usize];
            if other != own && !touch(own, other) && list[&own].may_be_inside(&list[&other]) {
                around_of.entry(own).or_default().push(other);
            }
        }
        Ok(())
    })?;
    // Samples of all over a component decide which of those that it touches are around it.
    let may_be: BTreeMap<u32, Vec<u32>> = touched
        .iter()
        .map(|(own, others)| {
            let may_be = others.iter().copied().filter(|other| list[own].may_be_in(&list[other]));
            (*own, may_be.collect::<Vec<u32>>())
        })
        .filter(|(_, others)| !others.is_empty())
        .collect();
    // Per component: its faces with an area; then the number that is passed.
    let mut counts: HashMap<u32, (usize, usize)> = may_be.keys().map(|own| (*own, (0, 0))).collect();
    faces.each(progress, &mut |face, _| {
        if let Some((count, _)) = counts.get_mut(&of_face.root(face.number as u32)) {
            *count += usize::from(face.has_area());
        }
        Ok(())
    })?;
    let mut chosen: HashMap<u32, u32> = HashMap::new();
    faces.each(progress, &mut |face, _| {
        let root = of_face.root(face.number as u32);
        let Some((count, passed)) = counts.get_mut(&root).filter(|_| face.has_area()) else { return Ok(()) };
        // The samples of the in-memory repair: every `count / samples`-th face.
        let samples = (*count).min(SAMPLES);
        let index = (*passed * samples).div_ceil(*count);
        if index < samples && index * *count / samples == *passed {
            chosen.insert(face.number as u32, root);
        }
        *passed += 1;
        Ok(())
    })?;
    // Per pair of components: whether a sample is outside, and whether one is inside.
    let mut sides: BTreeMap<(u32, u32), [bool; 2]> = BTreeMap::new();
    each_batch(faces, memory, progress, &mut |face| chosen.get(&face).copied(), &mut |samples, owners| {
        let mut windings: HashMap<(u32, u32), (i32, bool)> = HashMap::new();
        cast(faces, samples, progress, &mut |hit| {
            let own = owners[hit.sample as usize];
            let other = of_face.root(hit.face);
            if may_be[&own].binary_search(&other).is_ok() {
                let (winding, is_on) = windings.entry((hit.sample, other)).or_default();
                *winding += if hit.is_at { 0 } else { hit.up };
                *is_on |= hit.is_at;
            }
        })?;
        for (sample, own) in (0..).zip(owners) {
            for other in &may_be[own] {
                let (winding, is_on) = windings.get(&(sample, *other)).copied().unwrap_or_default();
                if !is_on {
                    sides.entry((*own, *other)).or_default()[usize::from(winding != 0)] = true;
                }
            }
        }
        Ok(())
    })?;
    for ((own, other), _) in sides.into_iter().filter(|(_, sides)| *sides == [false, true]) {
        around_of.entry(own).or_default().push(other);
    }
    let (turned, roots): (HashSet<u32>, u64) = root_components(list, &around_of);
    let (mut set, mut count) = (none, 0);
    for face in (0..faces.len as u32).filter(|face| turned.contains(&of_face.root(*face))) {
        set.set(face.into(), true);
        count += 1;
    }
    let volume = components.volume(|number| turned.contains(&number));
    Ok((set, Turned { roots, faces: count, volume }))
}

/// Visitor of samples, and of their owners.
type SampleVisitor<'v> = dyn FnMut(&[StoredSample], &[u32]) -> Result<()> + 'v;

/// Passes samples of the faces that have an owner to a function, with their owners, in batches of
/// about `memory` bytes.
///
/// # Errors
/// If temporary files cannot be read, those of the function, or on cancellation.
pub(super) fn each_batch(
    faces: &FaceSpool,
    memory: u64,
    progress: &dyn Progress,
    owner: &mut dyn FnMut(u32) -> Option<u32>,
    each: &mut SampleVisitor<'_>,
) -> Result<()> {
    let most = (memory / (2 * size_of::<StoredSample>() as u64)).max(1 << 8) as usize;
    let mut next = 0;
    while next < faces.len {
        let (mut samples, mut owners, first) = (Vec::new(), Vec::new(), next);
        next = faces.len;
        faces.each(progress, &mut |face, _| {
            if face.number < first || face.number >= next {
                return Ok(());
            }
            let Some(owner) = owner(face.number as u32) else { return Ok(()) };
            if samples.len() == most {
                next = face.number;
            } else if let Some(sample) = sample_of_face(face) {
                samples.push(sample);
                owners.push(owner);
            }
            Ok(())
        })?;
        if !samples.is_empty() {
            each(&samples, &owners)?;
        }
    }
    Ok(())
}
