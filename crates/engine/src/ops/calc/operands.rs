//! Operands of a calculation: what its names stand for, on one grid of cells.

use std::path::Path;

use super::calculation::{Calculation, Formula};
use super::expression::{Expression, Name};
use crate::ops::affine::{Sampling, View};
use crate::ops::reconcile::{ClassMatching, Needs, ReconcileOptions, Scale, Target, reconcile};
use crate::ops::tree_file::{LayerInfo, TreeFile};
use crate::ops::view_source::ViewSource;
use crate::ops::warp::Resampling;
use crate::tree::Source;
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};
use spinney_container::Metadata;

/// A channel of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Operand {
    /// The tree's number.
    pub(super) tree: usize,
    /// Channel, from 0.
    pub(super) channel: usize,
}

/// Factor and summand that make the numbers that are calculated with of those that are stored.
pub(super) type Linear = (f64, f64);

/// Expressions, one for each channel of the result, and the trees that their operands are channels of, all of one grid and depth. The first
/// is what the step is done to.
pub(super) struct Operands {
    pub(super) expressions: Vec<Expression>,
    pub(super) operands: Vec<Operand>,
    pub(super) trees: Vec<View>,
    /// By operand: the scale of its numbers, in the unit of the first operand where both measure the same. (A composite keeps numbers.)
    pub(super) scales: Vec<Linear>,
}

/// A tree by the name that expressions have for it.
struct Named {
    name: String,
    view: View,
}

/// Layers of the file that a view is of, in its order, each through the same steps as the view and on the same cells.
fn layers(view: &View) -> Result<Vec<(String, View)>> {
    let ViewSource::File(file) = &**view.source() else {
        return Ok(vec![(view.source().metadata().name.clone(), view.clone())]);
    };
    let layer = |(number, layer): (usize, LayerInfo)| match number == file.layer_number() {
        true => Ok((layer.name, view.clone())),
        false => Ok((layer.name, view.of_layer(file.open_layer(number)?.into())?)),
    };
    file.layers()?.into_iter().enumerate().map(layer).collect()
}

/// Finds what the names in a calculation stand for: files that are named beside it, layers and channels of what it is done to.
///
/// # Errors
/// If a file cannot be read or lies on another grid, or a name stands for nothing or for several things.
pub(super) fn resolve(calculation: &Calculation, view: &View) -> Result<Operands> {
    let base: Vec<Named> =
        layers(view)?.into_iter().map(|(name, view)| Named { name, view: by_rule(view) }).collect();
    let files: Result<Vec<Named>> =
        calculation.files.iter().map(|(name, path)| open(name, path, view)).collect();
    let files = files?;
    let (expressions, operands) = match &calculation.formula {
        Formula::Expression { expression, .. } => {
            let find = |name: &Name| find(name, &base, &files);
            let operands = expression.names().iter().map(find).collect::<Result<Vec<Operand>>>()?;
            for (index, file) in files.iter().enumerate() {
                if !operands.iter().any(|operand| operand.tree == base.len() + index) {
                    let expected = "an expression with the names of all files";
                    return Err(Error::invalid(
                        "calculation",
                        format!("a file `{}` that it does not use", file.name),
                        expected,
                    ));
                }
            }
            (vec![expression.clone()], operands)
        }
        Formula::Reduction(reducer) => {
            let mut operands = Vec::new();
            for (tree, named) in base.iter().chain(&files).enumerate() {
                // (Opacity is no band.)
                let alpha = named.view.source().metadata().alpha.map(usize::from);
                let channels = (0..channels(&named.view)).filter(|channel| Some(*channel) != alpha);
                operands.extend(channels.map(|channel| Operand { tree, channel }));
            }
            (vec![Expression::reduction(*reducer, operands.len())?], operands)
        }
        Formula::Composite(names) => {
            let find = |name: &Name| find_channel(&name.whole, &base);
            let operands = names.iter().map(find).collect::<Result<Vec<Operand>>>()?;
            ((0..operands.len()).map(Expression::operand).collect(), operands)
        }
    };
    let trees = aligned(base, files)?;
    let scales = match &calculation.formula {
        Formula::Composite(_) => operands.iter().map(|_| (1.0, 0.0)).collect(),
        _ => scales(&operands, &trees),
    };
    Ok(Operands { expressions, operands, trees, scales })
}

/// The scales of operands.
fn scales(operands: &[Operand], trees: &[View]) -> Vec<Linear> {
    let scale = |operand: &Operand| Scale::of(trees[operand.tree].source().metadata(), operand.channel);
    let first = operands.first().map(scale);
    let linear = |operand: &Operand| {
        let own = scale(operand);
        first.as_ref().and_then(|first| own.to_unit_of(first)).unwrap_or(own.plain_numbers())
    };
    operands.iter().map(linear).collect()
}

/// The channel that a name alone stands for: of a layer of that name, or a channel of its own; else, with a point in it, a layer's channel.
fn find_channel(name: &str, base: &[Named]) -> Result<Operand> {
    let whole =
        |name: &str, channel: Option<&str>| Name { whole: name.into(), channel: channel.map(Into::into) };
    let is_layer = base.iter().any(|layer| layer.name == name);
    let parts =
        name.rsplit_once('.').filter(|(layer, _)| !is_layer && base.iter().any(|other| other.name == *layer));
    let name = parts.map_or_else(|| whole(name, None), |(layer, channel)| whole(layer, Some(channel)));
    find(&name, base, &[])
}

/// The view as files are seen: where several of its cells become one, that is made by the rule.
fn by_rule(view: View) -> View {
    let rule = view.source().header().rule;
    let is_nearest = view.warp().resampling == Some(Resampling::Nearest);
    // (A view can be sampled in any way.)
    if is_nearest { view } else { view.clone().sampled(Sampling::Area(rule)).unwrap_or(view) }
}

fn open(name: &str, path: &Path, view: &View) -> Result<Named> {
    let file = TreeFile::open_only(path, &view.source().access().into())?;
    let (form, expected) = (file.form(), view.form());
    if form.dimension != expected.dimension {
        let expected =
            format!("{}, as {} is", expected.dimension.tree_name(), view.source().name().display());
        return Err(Error::invalid(path.display().to_string(), form.dimension.tree_name(), expected));
    }
    Ok(Named { name: name.into(), view: by_rule(View::whole(file.into())?) })
}

fn channels(view: &View) -> usize {
    view.form().value.channels.into()
}

fn find(name: &Name, base: &[Named], files: &[Named]) -> Result<Operand> {
    let unknown = |found: String| {
        let names: Vec<String> = known(base, files);
        let expected = format!("{}; or a file beside the expression: {}=FILE", names.join(", "), name.whole);
        Err(Error::invalid("name in a calculation", found, expected))
    };
    let trees = || base.iter().chain(files).enumerate();
    // Files that are named come first, so that no file's bands take a name away; then layers.
    let tree = trees()
        .skip(base.len())
        .chain(trees().take(base.len()))
        .find(|(_, named)| named.name == name.whole && !named.name.is_empty());
    match (tree, &name.channel) {
        (Some((tree, named)), Some(channel)) => match channel_of(channel, &named.view)? {
            Some(channel) => Ok(Operand { tree, channel }),
            None => {
                let path = named.view.source().name().display();
                let expected = format!("one of its channels: {}", names_of(&named.view).join(", "));
                Err(Error::invalid(
                    "name in a calculation",
                    format!("`{}.{channel}` of {path}", name.whole),
                    expected,
                ))
            }
        },
        (Some((tree, named)), None) => {
            if channels(&named.view) > 1 {
                let all =
                    names_of(&named.view).into_iter().map(|channel| format!("{}.{channel}", name.whole));
                let found = format!("`{}`, a file with {} channels", name.whole, channels(&named.view));
                return Err(Error::invalid(
                    "name in a calculation",
                    found,
                    all.collect::<Vec<_>>().join(", "),
                ));
            }
            Ok(Operand { tree, channel: 0 })
        }
        (None, Some(channel)) => unknown(format!("`{}.{channel}`", name.whole)),
        (None, None) => {
            let mut found = None;
            for (tree, named) in base.iter().enumerate() {
                if let Some(channel) = channel_by_name(&name.whole, named.view.source().metadata())?
                    && found.replace(Operand { tree, channel }).is_some()
                {
                    let expected = "one layer with a channel of that name; or LAYER.CHANNEL";
                    return Err(Error::invalid(
                        "name in a calculation",
                        format!("`{}`, of several layers", name.whole),
                        expected,
                    ));
                }
            }
            // By their numbers channels are those of all layers, one after the other.
            let mut number = number_of(&name.whole);
            for (tree, named) in base.iter().enumerate() {
                match number {
                    Some(channel) if channel < channels(&named.view) => {
                        found = found.or(Some(Operand { tree, channel }));
                        break;
                    }
                    Some(channel) => number = Some(channel - channels(&named.view)),
                    None => {}
                }
            }
            found.map_or_else(|| unknown(format!("`{}`", name.whole)), Ok)
        }
    }
}

/// What there is to name.
fn known(base: &[Named], files: &[Named]) -> Vec<String> {
    let files = files.iter().map(|file| file.name.clone());
    let layers = base.iter().filter(|layer| !layer.name.is_empty()).map(|layer| layer.name.clone());
    let bands = base.iter().flat_map(|layer| layer.view.source().metadata().band_names.iter().cloned());
    let count: usize = base.iter().map(|layer| channels(&layer.view)).sum();
    let numbers = if count == 1 { "b1".into() } else { format!("b1 to b{count}") };
    let names = files.chain(layers).chain(bands).filter(|name| !name.is_empty());
    // (There may be very many.)
    names.take(32).map(|name| format!("`{name}`")).chain([numbers]).collect()
}

/// The channel, from 0, that `b1`, `b2`, ... say.
fn number_of(name: &str) -> Option<usize> {
    let digits =
        name.strip_prefix('b').filter(|digits| digits.bytes().all(|digit| digit.is_ascii_digit()))?;
    digits.parse::<usize>().ok()?.checked_sub(1)
}

/// A channel of a view by its band's name, or by its number.
fn channel_of(name: &str, view: &View) -> Result<Option<usize>> {
    let by_name = channel_by_name(name, view.source().metadata())?;
    Ok(by_name.or_else(|| number_of(name).filter(|channel| *channel < channels(view))))
}

fn channel_by_name(name: &str, metadata: &Metadata) -> Result<Option<usize>> {
    let mut named = metadata.band_names.iter().enumerate().filter(|(_, band)| *band == name);
    match (named.next(), named.next()) {
        (Some((first, _)), Some((second, _))) => {
            let found = format!("`{name}`, of bands {} and {}", first + 1, second + 1);
            Err(Error::invalid("name in a calculation", found, "a name that one band has, or b1, b2, ..."))
        }
        (first, _) => Ok(first.map(|(channel, _)| channel)),
    }
}

/// Names of the channels of a view.
fn names_of(view: &View) -> Vec<String> {
    let names = &view.source().metadata().band_names;
    let name = |channel: usize| names.get(channel).filter(|name| !name.is_empty()).cloned();
    (0..channels(view)).map(|channel| name(channel).unwrap_or_else(|| format!("b{}", channel + 1))).collect()
}

/// All trees on the first's cells, over all of their extents. Classes keep their numbers, by which expressions name them.
fn aligned(base: Vec<Named>, files: Vec<Named>) -> Result<Vec<View>> {
    if files.is_empty() {
        let deepest = base.iter().map(|named| named.view.depth()).max().unwrap_or(0);
        return base.into_iter().map(|named| named.view.deepened(deepest)).collect();
    }
    let named = base.into_iter().chain(files);
    let operands = named.map(|named| (named.view.source().name().display().to_string(), named.view));
    let options = ReconcileOptions { classes: ClassMatching::Number, ..ReconcileOptions::default() };
    Ok(reconcile(operands.collect(), &|_| Needs::OwnValues, &options, Target::default())?.views)
}

impl Operands {
    /// The value type of an operand's tree, and its channel.
    pub(super) fn channel(&self, operand: usize) -> (ValueType, usize) {
        let Operand { tree, channel } = self.operands[operand];
        (self.trees[tree].form().value, channel)
    }

    /// Whether a tree has operands: no other is read.
    pub(super) fn is_read(&self, tree: usize) -> bool {
        self.operands.iter().any(|operand| operand.tree == tree)
    }

    /// The operands' trees.
    pub(super) fn read(&self) -> impl Iterator<Item = &View> {
        self.operands.iter().map(|operand| &self.trees[operand.tree])
    }
}
