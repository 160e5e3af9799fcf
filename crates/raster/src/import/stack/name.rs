//! Names of layers.

use std::collections::HashMap;

use super::super::bands::short_name;
use super::StackLayer;
use spinney_base::io::without_query;
use spinney_base::{Error, Result};

/// Assigns names to layers: the given ones; otherwise the name of the file if it makes one layer,
/// or those of its bands.
pub(super) fn give(layers: &mut [StackLayer], names: Option<&[String]>) -> Result<()> {
    if let Some(names) = names {
        if names.len() != layers.len() {
            let expected = format!("{}, one per layer", layers.len());
            return Err(Error::invalid("names", names.len().to_string(), expected));
        }
        layers.iter_mut().zip(names).for_each(|(layer, name)| layer.name.clone_from(name));
    } else {
        for layer in layers.iter_mut() {
            layer.name = of_file(layer);
        }
    }
    let mut seen: HashMap<&str, &StackLayer> = HashMap::new();
    for layer in layers.iter() {
        let about = |layer: &StackLayer| format!("band {} of {}", layer.channel() + 1, layer.path.display());
        if layer.name.trim().is_empty() {
            return Err(Error::invalid(
                "names",
                format!("no name for {}", about(layer)),
                "a name for each layer",
            ));
        }
        if let Some(other) = seen.insert(&layer.name, layer) {
            let found = format!("`{}` for {} and {}", layer.name, about(other), about(layer));
            return Err(Error::invalid(
                "names",
                found,
                "a unique name for each layer; set them with --names",
            ));
        }
    }
    Ok(())
}

/// Derives the name of a layer from its file.
fn of_file(layer: &StackLayer) -> String {
    let stem = without_query(&layer.path).file_stem().unwrap_or_default().to_string_lossy();
    let image = match layer.page {
        None => stem.into_owned(),
        Some(page) => format!("{stem}_{page}"),
    };
    match short_name(&layer.description) {
        _ if !layer.is_one_of_several => image,
        "" => format!("{image}_{}", layer.channel() + 1),
        name if layer.page.is_some() => format!("{image}_{name}"),
        name => name.into(),
    }
}
