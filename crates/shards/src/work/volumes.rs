//! Octrees of volumes.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::Dimension;
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_engine::store::TreeWriter;
use spinney_raster::volume::{RawLayout, VolumeInput, VolumeOptions};

use super::{PlannedWork, ShardTask, Work, WorkPlan, check_is_local};
use crate::stamp::absolute;

/// Volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Volume {
    input: Input,
    options: VolumeOptions,
}

/// How inputs are read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Input {
    File,
    Raw(RawLayout),
    Sections,
}

impl Volume {
    pub(super) fn of(input: &VolumeInput, options: &VolumeOptions) -> Volume {
        let input = match input {
            VolumeInput::File(_) => Input::File,
            VolumeInput::Sections(_) => Input::Sections,
            VolumeInput::Raw(_, layout) => Input::Raw(*layout),
        };
        Volume { input, options: options.clone() }
    }

    /// Volume of the given files.
    fn input(&self, paths: &[PathBuf]) -> Result<VolumeInput> {
        match (&self.input, paths) {
            (Input::Sections, _) => Ok(VolumeInput::Sections(paths.to_vec())),
            (Input::File, [path]) => Ok(VolumeInput::File(path.clone())),
            (Input::Raw(raw), [path]) => Ok(VolumeInput::Raw(path.clone(), *raw)),
            _ => Err(Error::invalid("inputs", paths.len().to_string(), "1 file")),
        }
    }
}

/// Writes the head file.
pub(super) fn write_head(
    input: &VolumeInput,
    options: &VolumeOptions,
    head: Output,
    progress: &dyn Progress,
) -> Result<WorkPlan> {
    let work = Volume::of(input, options);
    check_order(input, &work)?;
    let mut options = options.clone();
    options.access = head.access().clone();
    let volume = input.plan(&options)?;
    let description = volume.description().to_vec();
    let mut file = TreeWriter::head(head, (Dimension::Oct, volume.options().depth), 1)?;
    volume.write(&mut file, Path::new(""), progress)?;
    file.finish()?;
    Ok(WorkPlan { work: PlannedWork::Volume(Box::new(work)), loads: Vec::new(), ranges: None, description })
}

/// Checks that the sections have the same order by their absolute paths, which shards use, as by
/// the given paths.
fn check_order(input: &VolumeInput, work: &Volume) -> Result<()> {
    let absolutes = |paths: &[PathBuf]| paths.iter().map(|path| absolute(path)).collect::<Result<Vec<_>>>();
    let [given, planned] = [absolutes(&input.images()?)?, work.input(&absolutes(input.paths())?)?.images()?];
    let differs = given.iter().zip(&planned).find(|(given, planned)| given != planned);
    differs.map_or(Ok(()), |(path, _)| {
        let advice = "pass absolute paths of all sections, or relative paths of all";
        Err(Error::unsupported(
            path,
            "a volume of sections whose order depends on the working directory",
            advice,
        ))
    })
}

impl Work for Volume {
    fn files_of(&self, input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
        if self.input != Input::Sections {
            check_is_local(input)?;
        }
        self.input(&[input.to_path_buf()])?.files(access)
    }

    fn check(&self, inputs: usize, _: &[Header]) -> Result<()> {
        self.input(&vec![PathBuf::new(); inputs]).map(|_| ())
    }

    fn build(&self, part: ShardTask, memory: u64, progress: &dyn Progress) -> Result<()> {
        let mut options = self.options.clone();
        options.memory = Some(memory);
        options.access = part.shard.access.clone();
        let volume = self.input(&part.paths())?.plan(&options)?;
        let directory = part.shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Oct, volume.options().depth), 1)?;
        volume.write(&mut file, &directory, progress)?;
        file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::{DataKind, Number, Rule, SampleType};
    use spinney_crs::Crs;
    use spinney_engine::store::Packing;

    fn again(volume: &Volume) -> Volume {
        serde_json::from_str(&serde_json::to_string(volume).unwrap()).unwrap()
    }

    #[test]
    fn volume_work_survives_serialization() {
        let mut options = VolumeOptions::new();
        let sections = VolumeInput::Sections(vec!["a".into(), "b".into()]);
        let planned = again(&Volume::of(&sections, &options));
        assert_eq!(planned.options, options);
        assert_eq!(planned.input(sections.paths()).unwrap(), sections);
        planned.check(2, &[]).unwrap();
        (options.kind, options.rule) = (Some(DataKind::Categorical), Some(Rule::Majority));
        (options.nodata, options.depth) = (Some(Number::Float(0.1)), Some(9));
        options.transform =
            Some([[0.1, 0.0, 1e-300, 1e17], [0.0, 1.0 / 3.0, 0.0, -0.0], [0.0, 0.0, 7.0, 1.0]]);
        options.crs = Some(Crs::epsg(32632));
        options.packing = Packing::packed().max_error(Some(0.25));
        let mut layout = RawLayout::new([5, 4, 3], SampleType::I16);
        (layout.channels, layout.is_big_endian, layout.skip) = (2, true, 99);
        let raw = VolumeInput::Raw("a.raw".into(), layout);
        let planned = again(&Volume::of(&raw, &options));
        assert_eq!(planned.options, options);
        assert_eq!(planned.input(raw.paths()).unwrap(), raw);
        planned.check(2, &[]).unwrap_err();
    }

    #[test]
    fn plans_with_unknown_fields_or_invalid_values_are_rejected() {
        let raw = VolumeInput::Raw("a.raw".into(), RawLayout::new([1; 3], SampleType::U8));
        for (path, value) in [
            ("/options/kind", r#""odd""#),
            ("/options/nodata", r#""""#),
            ("/options/transform", r#"["1", "2"]"#),
            ("/options/packing/codec", r#""odd""#),
            ("/options/packing/max_error", r#""x""#),
            ("/input/raw/sample", r#""U9""#),
        ] {
            let json = serde_json::to_value(Volume::of(&raw, &VolumeOptions::new())).unwrap();
            let read = |json: &serde_json::Value| serde_json::from_value::<Volume>(json.clone());
            read(&json).unwrap();
            let mut wrong = json.clone();
            *wrong.pointer_mut(path).unwrap() = serde_json::from_str(value).unwrap();
            read(&wrong).unwrap_err();
            let mut more = json;
            let parent = more.pointer_mut(&path[..path.rfind('/').unwrap()]).unwrap();
            parent["odd"] = true.into();
            let error = read(&more).unwrap_err().to_string();
            assert!(error.contains("unknown field `odd`"), "{error}");
        }
    }
}
