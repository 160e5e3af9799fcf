//! Octrees of volumes.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::space::Dimension;
use spinney_base::value::{Number, SampleType};
use spinney_base::{Error, Progress, Result};
use spinney_container::Header;
use spinney_crs::Crs;
use spinney_engine::store::{Packing, TreeWriter};
use spinney_raster::volume::{RawLayout, VolumeInput, VolumeOptions};

use super::packing::PlannedPacking;
use super::{PartOfJob, PlannedWork, Told, Work, check_is_here, number};
use crate::stamp::absolute;

/// A volume. Numbers that are no whole ones are texts, so that every digit of them stays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Volume {
    input: Input,
    kind: Option<String>,
    rule: Option<String>,
    nodata: Option<String>,
    depth: Option<u8>,
    transform: Option<Vec<String>>,
    crs: Option<Crs>,
    packing: PlannedPacking,
}

/// The way in which inputs are read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Input {
    File,
    Raw(Raw),
    Sections,
}

/// Layout of a file of samples alone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    size: [u64; 3],
    sample: String,
    channels: u8,
    is_big_endian: bool,
    skip: u64,
}

impl Raw {
    fn layout(&self) -> Result<RawLayout> {
        let sample = SampleType::ALL.into_iter().find(|sample| sample.name() == self.sample);
        let sample =
            sample.ok_or_else(|| Error::invalid("sample", format!("`{}`", self.sample), "a type"))?;
        let mut layout = RawLayout::new(self.size, sample);
        (layout.channels, layout.is_big_endian, layout.skip) = (self.channels, self.is_big_endian, self.skip);
        Ok(layout)
    }
}

impl Volume {
    pub(super) fn of(input: &VolumeInput, options: &VolumeOptions) -> Volume {
        let input = match input {
            VolumeInput::File(_) => Input::File,
            VolumeInput::Sections(_) => Input::Sections,
            VolumeInput::Raw(_, RawLayout { size, sample, channels, is_big_endian, skip, .. }) => {
                let (sample, is_big_endian) = (sample.name().into(), *is_big_endian);
                Input::Raw(Raw { size: *size, sample, channels: *channels, is_big_endian, skip: *skip })
            }
        };
        let texts = |matrix: [[f64; 4]; 3]| matrix.as_flattened().iter().map(f64::to_string).collect();
        Volume {
            input,
            kind: options.kind.map(|kind| kind.to_string()),
            rule: options.rule.map(|rule| rule.to_string()),
            nodata: options.nodata.map(|nodata| nodata.to_string()),
            depth: options.depth,
            transform: options.transform.map(texts),
            crs: options.crs.clone(),
            packing: PlannedPacking::of(options.packing),
        }
    }

    /// The volume of some files.
    fn input(&self, paths: &[PathBuf]) -> Result<VolumeInput> {
        match (&self.input, paths) {
            (Input::Sections, _) => Ok(VolumeInput::Sections(paths.to_vec())),
            (Input::File, [path]) => Ok(VolumeInput::File(path.clone())),
            (Input::Raw(raw), [path]) => Ok(VolumeInput::Raw(path.clone(), raw.layout()?)),
            _ => Err(Error::invalid("inputs", paths.len().to_string(), "one file")),
        }
    }

    /// The options, with so many bytes of memory.
    fn options(&self, memory: Option<u64>) -> Result<VolumeOptions> {
        let mut options = VolumeOptions::new();
        options.memory = memory;
        options.kind = self.kind.as_deref().map(str::parse).transpose()?;
        options.rule = self.rule.as_deref().map(str::parse).transpose()?;
        options.nodata = self.nodata.as_deref().map(number::<Number>).transpose()?;
        (options.depth, options.crs) = (self.depth, self.crs.clone());
        if let Some(texts) = &self.transform {
            let numbers = texts.iter().map(|text| number(text)).collect::<Result<Vec<f64>>>()?;
            let (rows, rest) = numbers.as_chunks::<4>();
            let rows: Option<[[f64; 4]; 3]> = rows.try_into().ok().filter(|_| rest.is_empty());
            let found = || format!("{} numbers", texts.len());
            options.transform =
                Some(rows.ok_or_else(|| Error::invalid("transform", found(), "twelve numbers"))?);
        }
        options.packing = self.packing.packing()?;
        Ok(options)
    }
}

/// Writes a file that tells of the layer.
pub(super) fn write_head(
    input: &VolumeInput,
    options: &VolumeOptions,
    head: Output,
    progress: &dyn Progress,
) -> Result<Told> {
    let work = Volume::of(input, options);
    check_order(input, &work)?;
    let volume = input.plan(options)?;
    let description = volume.description().to_vec();
    let mut file = TreeWriter::head(head, (Dimension::Oct, volume.options().depth), 1)?;
    volume.write(&mut file, Path::new(""), progress)?;
    file.finish()?;
    Ok(Told { work: PlannedWork::Volume(Box::new(work)), loads: Vec::new(), pieces: None, description })
}

/// Makes sure that planes have the same order by the paths that shards have, which are those from the root of the file system on.
fn check_order(input: &VolumeInput, work: &Volume) -> Result<()> {
    let absolutes = |paths: &[PathBuf]| paths.iter().map(|path| absolute(path)).collect::<Result<Vec<_>>>();
    let [given, planned] =
        [absolutes(&input.pictures()?)?, work.input(&absolutes(input.paths())?)?.pictures()?];
    let differs = given.iter().zip(&planned).find(|(given, planned)| given != planned);
    differs.map_or(Ok(()), |(path, _)| {
        let advice = "give the paths of all from the root of the file system on, or of none";
        Err(Error::unsupported(path, "sections whose order depends on how their paths are told", advice))
    })
}

impl Work for Volume {
    fn files_of(&self, input: &Path) -> Result<Vec<PathBuf>> {
        if self.input != Input::Sections {
            check_is_here(input)?;
        }
        self.input(&[input.to_path_buf()])?.files()
    }

    fn packing(&self) -> Result<Packing> {
        self.packing.packing()
    }

    fn check(&self, inputs: usize, _: &[Header]) -> Result<()> {
        self.input(&vec![PathBuf::new(); inputs])?;
        self.options(None).map(|_| ())
    }

    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()> {
        let volume = self.input(&part.paths())?.plan(&self.options(Some(memory))?)?;
        let folder = part.shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Oct, volume.options().depth), 1)?;
        volume.write(&mut file, &folder, progress)?;
        file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::{DataKind, Rule};
    use spinney_engine::store::Effort;

    fn again(volume: &Volume) -> Volume {
        serde_json::from_str(&serde_json::to_string(volume).unwrap()).unwrap()
    }

    #[test]
    fn volumes_come_back() {
        let mut options = VolumeOptions::new();
        let sections = VolumeInput::Sections(vec!["a".into(), "b".into()]);
        let planned = again(&Volume::of(&sections, &options));
        assert_eq!(planned.options(None).unwrap(), options);
        assert_eq!(planned.input(sections.paths()).unwrap(), sections);
        planned.check(2, &[]).unwrap();
        (options.kind, options.rule) = (Some(DataKind::Categorical), Some(Rule::Majority));
        (options.nodata, options.depth) = (Some(Number::Float(0.1)), Some(9));
        options.transform =
            Some([[0.1, 0.0, 1e-300, 1e17], [0.0, 1.0 / 3.0, 0.0, -0.0], [0.0, 0.0, 7.0, 1.0]]);
        options.crs = Some(Crs::epsg(32632));
        options.packing = Packing::packed(Effort::Small).max_error(Some(0.25));
        let mut layout = RawLayout::new([5, 4, 3], SampleType::I16);
        (layout.channels, layout.is_big_endian, layout.skip) = (2, true, 99);
        let raw = VolumeInput::Raw("a.raw".into(), layout);
        let planned = again(&Volume::of(&raw, &options));
        assert_eq!(planned.options(None).unwrap(), options);
        assert_eq!(planned.input(raw.paths()).unwrap(), raw);
        planned.check(2, &[]).unwrap_err();
    }

    #[test]
    fn volumes_that_make_no_sense_are_refused() {
        let file = VolumeInput::File("a.npy".into());
        for (key, value) in [
            ("kind", r#""odd""#),
            ("nodata", r#""""#),
            ("transform", r#"["1", "2"]"#),
            (
                "input",
                r#"{"raw": {"size": [1, 1, 1], "sample": "u9", "channels": 1, "is_big_endian": false, "skip": 0}}"#,
            ),
        ] {
            let mut json = serde_json::to_value(Volume::of(&file, &VolumeOptions::new())).unwrap();
            json[key] = serde_json::from_str(value).unwrap();
            let planned: Volume = serde_json::from_value(json).unwrap();
            assert!(planned.check(1, &[]).is_err(), "{key}");
        }
    }
}
