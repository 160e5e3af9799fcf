//! Levels of detail of exact models, simplified by meshoptimizer.

use meshoptimizer_rs::{
    Attributes, Positions, SimplifyOptions, SimplifySettings, VertexFlags, Workspace,
    simplify_with_attributes,
};
use spinney_base::io::{Output, directory_of};
use spinney_base::{Error, Progress, Result};
use spinney_brep::{DetailLevel, ExactModel, Simplifier};
use spinney_container::{Codec, OpenOptions};

/// Collapses edges in the order of quadric errors (Garland and Heckbert, 1997).
struct EdgeCollapse;

impl Simplifier for EdgeCollapse {
    fn simplify(
        &self,
        points: &[[f32; 3]],
        triangles: &[[u32; 3]],
        locked: &[bool],
        goal: usize,
        error: f32,
    ) -> Vec<[u32; 3]> {
        let flag = |is_locked: &bool| if *is_locked { VertexFlags::LOCK } else { VertexFlags::EMPTY };
        let flags: Vec<VertexFlags> = locked.iter().map(flag).collect();
        let settings = SimplifySettings {
            target_index_count: 3 * goal,
            target_error: error,
            options: SimplifyOptions::ERROR_ABSOLUTE,
        };
        let simplified = Attributes::from_interleaved(&[], points.len(), 0, 0, 0).and_then(|none| {
            let (positions, mut workspace) = (Positions::from_packed(points), Workspace::default());
            simplify_with_attributes(
                triangles.as_flattened(),
                positions,
                none,
                &[],
                Some(&flags),
                settings,
                &mut workspace,
            )
        });
        // (What cannot be simplified stays as it is.)
        simplified.map_or_else(|_| triangles.to_vec(), |mesh| mesh.indices.as_chunks().0.to_vec())
    }
}

/// Copies an exact model with a codec, and adds levels of detail; existing ones are replaced. See
/// [`spinney_brep::add_levels`].
///
/// # Errors
/// Those of [`spinney_brep::add_levels`].
pub fn add_levels(
    model: &ExactModel,
    output: (Output, Codec),
    memory: u64,
    progress: &dyn Progress,
) -> Result<Vec<DetailLevel>> {
    spinney_brep::add_levels(model, &EdgeCollapse, output, memory, progress)
}

/// Writes an exact model with levels of detail: a function writes it without levels to a temporary
/// file next to the output, if it finds no defects. See [`add_levels`].
///
/// # Errors
/// Those of the function and of [`add_levels`].
pub fn with_levels<R>(
    output: Output,
    memory: u64,
    progress: &dyn Progress,
    make: impl FnOnce(Output) -> Result<R>,
) -> Result<R> {
    let path = output.path().to_path_buf();
    let directory =
        if output.is_file() { tempfile::tempdir_in(directory_of(&path)) } else { tempfile::tempdir() };
    let directory = directory.map_err(Error::io(&path, "create a temporary directory"))?;
    let temporary = directory.path().join("exact.goblin");
    let made = make(Output::create(&temporary)?)?;
    if temporary.exists() {
        let model = ExactModel::open(&temporary, &OpenOptions::default())?;
        add_levels(&model, (output, model.codec()), memory, progress)?;
    }
    Ok(made)
}
