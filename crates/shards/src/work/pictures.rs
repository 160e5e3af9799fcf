//! Trees of pictures, of which several are a mosaic.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::Output;
use spinney_base::space::{Bounds, Dimension, Region};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, OpenOptions};
use spinney_engine::store::goblin::{Goblin, Shard};
use spinney_engine::store::{Packing, TreeWriter};
use spinney_raster::import::{ImportOptions, MosaicPlan, plan, plan_part};

use super::import_options::PlannedImport;
use super::{Load, PartOfJob, PlannedWork, Told, Work, number};
use crate::job::PlannedInput;

/// A picture, or several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Pictures {
    options: PlannedImport,
    mosaic: Option<Mosaic>,
}

/// Mosaic of several pictures on one grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Mosaic {
    size: [u64; 2],
    nodata: Option<String>,
    flag_all: bool,
    /// Of each input its first column and row, and how many it has.
    regions: Vec<[u64; 4]>,
}

impl Mosaic {
    fn of(mosaic: &MosaicPlan) -> Mosaic {
        let region = |Region { x, y, width, height }: &Region| [*x, *y, *width, *height];
        Mosaic {
            size: mosaic.size,
            nodata: mosaic.nodata.map(|nodata| nodata.to_string()),
            flag_all: mosaic.flag_all,
            regions: mosaic.regions.iter().map(region).collect(),
        }
    }

    fn region(&self, input: usize) -> Region {
        let [x, y, width, height] = self.regions[input];
        Region::new(x, y, width, height)
    }

    /// The mosaic of some of its inputs.
    fn plan(&self, inputs: impl Iterator<Item = usize>) -> Result<MosaicPlan> {
        let nodata = self.nodata.as_deref().map(number).transpose()?;
        let mut mosaic = MosaicPlan::new(self.size, nodata, self.flag_all);
        mosaic.regions = inputs.map(|input| self.region(input)).collect();
        Ok(mosaic)
    }

    /// Whether it is the only layer, and has so many inputs.
    fn fits(&self, inputs: usize, layers: &[Header]) -> bool {
        let is_inside = |[x, y, width, height]: &[u64; 4]| {
            x.checked_add(*width).is_some_and(|right| right <= self.size[0])
                && y.checked_add(*height).is_some_and(|bottom| bottom <= self.size[1])
        };
        let is_layer =
            matches!(layers, [header] if header.extent[..2] == self.size && header.form.axes() == 2);
        is_layer && self.regions.len() == inputs && self.regions.iter().all(is_inside)
    }
}

impl Pictures {
    pub(super) fn of(options: &ImportOptions) -> Pictures {
        Pictures { options: PlannedImport::of(options), mosaic: None }
    }
}

/// Writes a file that tells of the layer.
pub(super) fn write_head(
    (paths, inputs): (&[PathBuf], &[PlannedInput]),
    options: &ImportOptions,
    head: Output,
    progress: &dyn Progress,
) -> Result<Told> {
    let picture = plan(paths, options)?;
    let whole = [Region::new(0, 0, picture.info().width, picture.info().height)];
    let regions = picture.mosaic().map_or(&whole[..], |mosaic| &mosaic.regions);
    let loads = regions.iter().zip(inputs).map(|(region, input)| {
        let (min, max) = ([region.x, region.y, 0], [region.right(), region.bottom(), 1]);
        Load { layer: 0, cells: Bounds { min, max }, bytes: input.bytes() }
    });
    let (loads, description) = (loads.collect(), picture.description().to_vec());
    let mosaic = picture.mosaic().map(Mosaic::of);
    let mut file = TreeWriter::head(head, (Dimension::Quad, picture.options().depth), 1)?;
    picture.write(&mut file, Path::new(""), progress)?;
    file.finish()?;
    let work = PlannedWork::Pictures(Box::new(Pictures { mosaic, ..Pictures::of(options) }));
    Ok(Told { work, loads, pieces: None, description })
}

impl Work for Pictures {
    fn files_of(&self, input: &Path) -> Result<Vec<PathBuf>> {
        self.options.files_of(input)
    }

    fn packing(&self) -> Result<Packing> {
        self.options.packing()
    }

    fn check(&self, inputs: usize, layers: &[Header]) -> Result<()> {
        self.options.import(None)?;
        let Some(mosaic) = &self.mosaic else { return Ok(()) };
        mosaic.plan([].into_iter())?;
        if !mosaic.fits(inputs, layers) {
            return Err(Error::invalid("mosaic", "inputs that are not in it", "places of all inputs in it"));
        }
        Ok(())
    }

    /// Of a mosaic those alone that have pixels there.
    fn touched(&self, inputs: usize, shard: &Shard, layers: &[Header]) -> Vec<usize> {
        let Some(mosaic) = &self.mosaic else { return (0..inputs).collect() };
        let depth = layers.first().map_or(0, Header::depth);
        let touches = |region: Region| {
            let cells = Bounds { min: [region.x, region.y, 0], max: [region.right(), region.bottom(), 1] };
            shard.pieces.iter().any(|piece| piece.run.cells(Dimension::Quad, depth, &cells) > 0)
        };
        (0..inputs).filter(|input| touches(mosaic.region(*input))).collect()
    }

    fn build(&self, part: PartOfJob, memory: u64, progress: &dyn Progress) -> Result<()> {
        let options = self.options.import(Some(memory))?;
        let paths = part.paths();
        let picture = match &self.mosaic {
            None => plan(&paths, &options)?,
            Some(mosaic) => {
                let mosaic = mosaic.plan(part.inputs.iter().map(|(number, _)| *number))?;
                let head = Goblin::open(&part.head, &OpenOptions::default())?;
                plan_part(&paths, &mosaic, (head.header(), head.metadata()), &options)?
            }
        };
        let folder = part.shard.temporary().to_path_buf();
        let mut file = part.target().start((Dimension::Quad, picture.options().depth), 1)?;
        picture.write(&mut file, &folder, progress)?;
        file.finish()
    }
}
