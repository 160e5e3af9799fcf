//! Objects of models: which objects an exact model includes, and which are left out and why.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::Model;
use super::ExactOptions;
use super::boundary::{self, Boundary, Groups};
use spinney_base::{Error, Progress, Result, parallel};
use spinney_brep::{Face, FaceList, Faces, body_flaw};

/// Object that was left out.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SkippedObject {
    /// Name of the object, or of the file if it has only one object.
    pub name: String,
    /// Description of the flaw that prevents it from being a body, with a location.
    pub why: String,
}

/// Parts of all models, numbered consecutively over the models.
pub(super) struct Objects {
    /// Name and object number of each part. An object's number is the number of one of its parts.
    parts: Vec<(String, u32)>,
    /// Number of each part in the exact model; `None` if left out.
    numbers: Vec<Option<u32>>,
    /// Number in `parts` of each part of the exact model.
    taken: Vec<u32>,
}

impl Objects {
    /// Chosen parts of models; all if `chosen` is `None`.
    pub(super) fn of(models: &[Box<dyn Model>], chosen: Option<&BTreeSet<u32>>) -> Result<Objects> {
        let mut parts = Vec::new();
        for info in models.iter().map(|model| model.info()) {
            let first = parts.len() as u32;
            // (If the file is one object, its parts are named after the file.)
            let is_whole = info.is_grouped || info.parts.len() == 1;
            for (part, name) in (first..).zip(&info.parts) {
                parts.push(match is_whole {
                    true => (info.path.display().to_string(), first),
                    false => (name.clone(), part),
                });
            }
        }
        let mut objects = Objects { numbers: vec![None; parts.len()], parts, taken: Vec::new() };
        objects.take(&|part| chosen.is_none_or(|chosen| chosen.contains(&part)));
        if objects.numbers.iter().all(Option::is_none) {
            return Err(Error::invalid("objects", "none in the selection", "one or more"));
        }
        Ok(objects)
    }

    /// Numbers the parts to include.
    fn take(&mut self, is_taken: &dyn Fn(u32) -> bool) {
        self.taken = (0..self.parts.len() as u32).filter(|part| is_taken(*part)).collect();
        self.numbers.fill(None);
        for (number, part) in (0..).zip(&self.taken) {
            self.numbers[*part as usize] = Some(number);
        }
    }

    /// Object of a part of the exact model.
    pub(super) fn object(&self, number: u32) -> u32 {
        self.parts[self.taken[number as usize] as usize].1
    }

    /// Number of a part in the exact model, if it is included.
    pub(super) fn number(&self, part: u32) -> Option<u32> {
        self.numbers.get(part as usize).copied().flatten()
    }

    /// Parts that are included; `None` if all are.
    pub(super) fn some(&self) -> Option<BTreeSet<u32>> {
        (self.taken.len() < self.parts.len()).then(|| self.taken.iter().copied().collect())
    }

    /// Group of each part's object, for all parts.
    pub(super) fn joined(&self, groups: &Groups) -> Vec<u32> {
        self.parts.iter().map(|(_, object)| groups.group(*object)).collect()
    }

    /// Names of all parts, indexed by object number.
    pub(super) fn names(&self) -> Vec<String> {
        self.parts.iter().map(|(name, _)| name.clone()).collect()
    }

    /// Number of included objects. (Parts of an object are consecutive, and objects have the
    /// numbers of their first parts.)
    pub(super) fn count(&self) -> u64 {
        let is_first = |number: &u32| *number == 0 || self.object(number - 1) != self.object(*number);
        (0..self.taken.len() as u32).filter(is_first).count() as u64
    }

    /// Name of the object of a part of the exact model, if there are several objects.
    pub(super) fn name(&self, number: u32) -> Option<&str> {
        let last = (self.taken.len() as u32).checked_sub(1)?;
        if self.object(0) == self.object(last) {
            return None;
        }
        Some(&self.parts[*self.taken.get(number as usize)? as usize].0)
    }

    /// Leaves out objects that are not bodies. `faces` are those of the included parts.
    pub(super) fn skip_bad(
        &mut self,
        faces: &FaceList,
        options: &ExactOptions,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<Vec<SkippedObject>> {
        // (Patches of one surface are one body.)
        let groups = match options.close {
            true => self.groups(faces, path, options.memory / 4, progress)?,
            false => Groups::default(),
        };
        let object = |face: &Face<'_>| groups.group(self.object(face.part));
        let mut order: Vec<u32> = (0..faces.len() as u32).collect();
        spinney_base::sort::by_key(&mut order, |face| object(&faces.get(*face as usize)).into());
        let runs: Vec<&[u32]> = order
            .chunk_by(|a, b| object(&faces.get(*a as usize)) == object(&faces.get(*b as usize)))
            .collect();
        let rule = options.repair.then_some(options.inside);
        // (The faces take up to half of the memory. Each thread checks one object at a time.)
        let memory = options.memory / 2 / parallel::threads() as u64;
        let flaws = parallel::map(&runs, |run| {
            progress.check()?;
            let mut own = FaceList::new(faces.grid().clone(), Vec::new());
            run.iter().for_each(|face| own.push(&faces.get(*face as usize)));
            if options.close {
                close(&mut own, path, memory, progress)?;
            }
            let flaw = body_flaw(&own, rule, path, memory, progress)?;
            progress.advance(run.len() as u64, faces.len());
            Ok(flaw)
        });
        let mut skipped = Vec::new();
        let mut bad = BTreeSet::new();
        for (run, flaw) in runs.iter().zip(flaws) {
            let Some(why) = flaw? else { continue };
            let number = object(&faces.get(run[0] as usize));
            bad.insert(number);
            let own: BTreeSet<u32> =
                run.iter().map(|face| self.object(faces.get(*face as usize).part)).collect();
            let name = |object: u32| self.parts[object as usize].0.clone();
            skipped
                .extend(own.into_iter().map(|object| SkippedObject { name: name(object), why: why.clone() }));
        }
        if bad.len() == runs.len() {
            // (Closing objects often makes intersections, or leaves those that it cannot see.)
            let way = match (options.close, options.repair) {
                (false, false) => "close them and resolve intersections with `--close --repair`, or ",
                (false, true) => "close them with --close, or ",
                (true, false) => "resolve intersections with --repair, or ",
                (true, true) => "",
            };
            let locations = skipped.iter().take(100).map(|object| format!("{}: {}", object.name, object.why));
            return Err(Error::NotASolid {
                path: path.to_path_buf(),
                what: "none of its objects is a body".into(),
                locations: locations.collect(),
                count: skipped.len() as u64,
                advice: format!("{way}build cells (without --brep)"),
            });
        }
        let taken: BTreeSet<u32> = self.taken.iter().copied().collect();
        let objects: Vec<u32> = self.parts.iter().map(|(_, object)| *object).collect();
        self.take(&|part| taken.contains(&part) && !bad.contains(&groups.group(objects[part as usize])));
        Ok(skipped)
    }
}

impl Objects {
    /// Groups of objects that close each other.
    fn groups(&self, faces: &FaceList, path: &Path, memory: u64, progress: &dyn Progress) -> Result<Groups> {
        let mut boundary = Boundary::new(&std::env::temp_dir(), memory);
        (0..faces.len() as usize).try_for_each(|number| {
            let face = faces.get(number);
            boundary.add_face(&face, self.object(face.part))
        })?;
        Ok(boundary.loops(path, memory, progress)?.groups)
    }
}

/// Adds triangles over the boundaries of an object.
fn close(faces: &mut FaceList, path: &Path, memory: u64, progress: &dyn Progress) -> Result<()> {
    let mut boundary = Boundary::new(&std::env::temp_dir(), memory / 4);
    (0..faces.len() as usize).try_for_each(|number| boundary.add_face(&faces.get(number), 0))?;
    let loops = boundary.loops(path, memory / 4, progress)?.loops;
    boundary::close(&loops, (faces.len(), u64::MAX), faces.is_coloured(), progress, &mut |face| {
        faces.push(face);
        Ok(())
    })
}
