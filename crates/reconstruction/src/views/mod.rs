//! Space carving: solids from images with known directions. A cell is kept if no image shows it to
//! be empty.

mod image;
mod pyramid;
mod view;
mod views_file;

use std::path::Path;

use self::view::View;
use self::views_file::ViewsFile;
use crate::linear::Limits;
use crate::plan::{ReconstructionImport, check};
use crate::source::{Bits, Block, BlockState, Solid};
use spinney_base::Result;
use spinney_base::io::FileAccess;
use spinney_mesh::import::{SolidOptions, fit_cells};

/// Whether a file name has the extension of a views file, `.views`.
pub fn is_views_name(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("views"))
}

/// Reads a views file and its images, and plans the octree of all cells that no image shows to be
/// empty. `docs/reconstruction.md` defines the file format. Images are held in memory, in up to
/// half of the memory limit of the options.
///
/// ```
/// use spinney::import::mesh::{Resolution, SolidOptions};
/// use spinney::Output;
/// use spinney::raw::reconstruction::plan_views;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = |name: &str| directory.path().join(name);
/// // The left half of a square, as a chain code, viewed from above.
/// let half = "freeman-chain-code 1\ndirections 4\nsize 4 4\nregion 1 0 0\n333300111122\nend\n";
/// std::fs::write(path("half.chain"), half).unwrap();
/// let view = r#"{"image": "half.chain", "kind": "silhouette", "from": [180, 90], "centre": [2, 2, 2], "pixel": 1}"#;
/// let text = format!(r#"{{"bounds": [0, 0, 0, 4, 4, 4], "views": [{view}]}}"#);
/// std::fs::write(path("half.views"), text).unwrap();
/// let mut options = SolidOptions::new();
/// options.resolution = Resolution::Cells(8);
/// let import = plan_views(&path("half.views"), &options, &Default::default())?;
/// assert_eq!(import.build(Output::create(&path("half.goblin"))?, &())?, 4 * 8 * 8);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the views file or an image cannot be read or is invalid; if an image may not be accessed; if
/// the options are not supported, or the memory limit is too low for the images.
pub fn plan_views(path: &Path, options: &SolidOptions, access: &FileAccess) -> Result<ReconstructionImport> {
    check(path, options)?;
    let text = ViewsFile::open(path)?;
    text.views.iter().try_for_each(|view| access.check_external(path, &view.image))?;
    let mut options = options.clone();
    options.unit = options.unit.or_else(|| text.unit.clone());
    let cells = fit_cells(text.bounds, &options)?;
    let frame = &cells.frame.matrix;
    let along = f64::from(1u32 << cells.depth);
    let mut left = options.memory / 2;
    let views =
        (text.views.iter()).map(|view| View::open(view, (frame, along), (&mut left, options.memory / 4)));
    let views: Vec<View> = views.collect::<Result<_>>()?;
    let silhouettes = views.iter().filter(|view| view.is_silhouette()).count();
    let input_description = vec![
        ("input", path.display().to_string()),
        ("views", format!("{silhouettes} silhouettes, {} depth images", views.len() - silhouettes)),
        ("fill", "what no view shows to be empty: cells by their centres".into()),
    ];
    let provenance = format!("{}: carved by {} views", path.display(), views.len());
    let limits = Limits::new(text.bounds, frame, along);
    let solid = Box::new(Carved { limits, views });
    Ok(ReconstructionImport::new(solid, cells, options, (None, provenance, input_description)))
}

/// The cells of a box that no view shows to be empty.
struct Carved {
    limits: Limits,
    views: Vec<View>,
}

impl Solid for Carved {
    fn input_count(&self) -> u32 {
        self.views.len() as u32
    }

    fn classify(&self, block: Block, near: &[u32], still: &mut Vec<u32>) -> BlockState {
        let mut state = self.limits.classify(block);
        if state == BlockState::Void {
            return BlockState::Void;
        }
        for number in near {
            match self.views[*number as usize].classify(block) {
                BlockState::Void => return BlockState::Void,
                BlockState::Full => {}
                BlockState::Mixed => {
                    still.push(*number);
                    state = BlockState::Mixed;
                }
            }
        }
        state
    }

    fn cells(&self, block: Block, near: &[u32]) -> Bits {
        Bits::of(block.width, &mut |position| {
            let centre = block.cell(position);
            self.limits.has(centre) && near.iter().all(|number| self.views[*number as usize].leaves(centre))
        })
    }
}
