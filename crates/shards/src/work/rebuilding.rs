//! Trees of one other with the same cells, of which something else is said.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, OpenOptions};
use spinney_crs::Crs;
use spinney_engine::dataset::{Rebuild, open};
use spinney_engine::store::{Packing, TreeTarget};

use super::packing::PlannedPacking;
use super::trees::{LITTLE, files_of};
use super::{PartOfJob, PlannedWork, Told, Work, number};

/// Properties that are to be other than in the tree. Numbers that are no whole ones are texts, so that every digit of them stays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rebuilding {
    kind: Option<String>,
    rule: Option<String>,
    depth: Option<u8>,
    matrix: Option<[[String; 4]; 3]>,
    crs: Option<Crs>,
    packing: PlannedPacking,
}

impl Rebuilding {
    pub(super) fn of(other: &Rebuild, packing: Packing) -> Rebuilding {
        Rebuilding {
            kind: other.kind.map(|kind| kind.to_string()),
            rule: other.rule.map(|rule| rule.to_string()),
            depth: other.depth,
            matrix: other.matrix.map(|rows| rows.map(|row| row.map(|number| number.to_string()))),
            crs: other.crs.clone(),
            packing: PlannedPacking::of(packing),
        }
    }

    fn rebuild(&self) -> Result<Rebuild> {
        let mut other = Rebuild { depth: self.depth, crs: self.crs.clone(), ..Rebuild::default() };
        other.kind = self.kind.as_deref().map(str::parse).transpose()?;
        other.rule = self.rule.as_deref().map(str::parse).transpose()?;
        if let Some(texts) = &self.matrix {
            let mut matrix = [[0.0; 4]; 3];
            for (place, text) in matrix.as_flattened_mut().iter_mut().zip(texts.as_flattened()) {
                *place = number(text)?;
            }
            other.matrix = Some(matrix);
        }
        Ok(other)
    }
}

/// Builds the tree, or a part of it.
fn build(
    path: &Path,
    (other, packing): (&Rebuild, Packing),
    memory: u64,
    target: TreeTarget,
    progress: &dyn Progress,
) -> Result<[(&'static str, String); 3]> {
    let tree = open(path, &OpenOptions::default())?;
    let mut options = tree.rebuild_options(other, memory)?;
    options.packing = packing;
    tree.build_to(&options, target, progress)?;
    Ok([
        ("kind", options.kind.to_string()),
        ("rule", options.rule.to_string()),
        ("depth", format!("{} levels", options.depth)),
    ])
}

/// Writes a file that tells of the layer.
pub(super) fn write_head(
    path: &Path,
    (other, packing): (&Rebuild, Packing),
    head: Output,
    progress: &dyn Progress,
) -> Result<Told> {
    let described = build(path, (other, packing), LITTLE, TreeTarget::Head(head), progress)?;
    let work = PlannedWork::Rebuild(Box::new(Rebuilding::of(other, packing)));
    Ok(Told { work, loads: Vec::new(), pieces: None, description: described.into() })
}

impl Work for Rebuilding {
    fn files_of(&self, input: &Path) -> Result<Vec<PathBuf>> {
        files_of(input)
    }

    fn packing(&self) -> Result<Packing> {
        self.packing.packing()
    }

    fn check(&self, inputs: usize, _: &[Header]) -> Result<()> {
        self.packing()?;
        self.rebuild()?;
        match inputs {
            1 => Ok(()),
            _ => Err(Error::invalid("inputs", inputs.to_string(), "one tree")),
        }
    }

    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()> {
        let how = (&self.rebuild()?, self.packing()?);
        let (_, path) = part.inputs[0].clone();
        build(&path, how, memory, part.target(), progress).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::{DataKind, Rule};

    #[test]
    fn what_is_other_comes_back() {
        let matrix = [[0.1, 0.0, 0.0, 1e-300], [0.0, -1.0 / 3.0, 0.0, 5.0], [0.0, 0.0, 1.0, 0.0]];
        let (kind, rule) = (Some(DataKind::Categorical), Some(Rule::Max));
        let other = Rebuild { kind, rule, depth: Some(12), matrix: Some(matrix), crs: Some(Crs::epsg(4326)) };
        for other in [other, Rebuild::default()] {
            let text = serde_json::to_string(&Rebuilding::of(&other, Packing::default())).unwrap();
            let again: Rebuilding = serde_json::from_str(&text).unwrap();
            assert_eq!(again.rebuild().unwrap(), other);
        }
    }
}
