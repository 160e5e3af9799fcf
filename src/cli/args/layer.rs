//! Layers of a file.

use std::path::{Path, PathBuf};

use clap::Args;
use spinney::raw::ops::{layer_paths, only_layer};
use spinney::raw::store::FileReference;

use super::Global;

/// One or several layers of a file.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct LayerOption {
    /// Layer of a file that has several: by name or number from 0, also as FILE:LAYER; two to four
    /// (B04,B03,B02) become the colours of an image [default: all, where possible]
    #[arg(long = "layer", value_name = "LAYER,...")]
    names: Option<String>,
}

impl LayerOption {
    /// Returns the paths of the chosen layers; of all layers if none is named.
    pub(crate) fn paths(&self, file: &Path, global: &Global) -> spinney::Result<Vec<PathBuf>> {
        let all = layer_paths(file, global.access())?;
        let Some(names) = &self.names else { return Ok(all) };
        let reference = FileReference::of(file);
        // (A layer's name may contain commas.)
        let is_name = all.iter().any(|path| FileReference::of(path).layer.as_ref() == Some(names));
        let named = |name: &str| reference.of_layer(name);
        Ok(if is_name {
            vec![named(names)]
        } else {
            names.split(',').map(|name| named(name.trim())).collect()
        })
    }

    /// Returns the path of the only chosen layer.
    pub(crate) fn path(&self, file: &Path, global: &Global) -> spinney::Result<PathBuf> {
        match &self.paths(file, global)?[..] {
            [path] => Ok(path.clone()),
            _ if self.is_given() => {
                Err(spinney::Error::invalid(format!("{}: --layer", file.display()), "several layers", "one"))
            }
            _ => {
                only_layer(file, global.access())?;
                Ok(file.into())
            }
        }
    }

    /// Returns the argument of `--layer`, unparsed.
    pub(crate) fn text(&self) -> Option<&str> {
        self.names.as_deref()
    }

    /// Whether layers are named.
    pub(crate) fn is_given(&self) -> bool {
        self.names.is_some()
    }
}
