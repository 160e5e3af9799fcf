//! Operands of a calculation: the channels that its names refer to, on one grid of cells.

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

/// Channel of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Operand {
    /// Index of the tree.
    pub(super) tree: usize,
    /// Channel, from 0.
    pub(super) channel: usize,
}

/// Factor and summand that convert stored numbers to those of the calculation.
pub(super) type Linear = (f64, f64);

/// Expressions, one for each channel of the result, and the trees that have their operands as
/// channels, all of one grid and depth. The first tree is the one that the calculation is applied
/// to.
pub(super) struct Operands {
    pub(super) expressions: Vec<Expression>,
    pub(super) operands: Vec<Operand>,
    pub(super) trees: Vec<View>,
    /// Scale of each operand's numbers, in the unit of the first operand if both measure the same
    /// quantity. (A composite does not scale.)
    pub(super) scales: Vec<Linear>,
}

/// Tree with its name in expressions.
struct Named {
    name: String,
    view: View,
}

/// Layers of the view's file, in file order, each through the same operations as the view and on
/// the same cells.
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

/// Resolves the names in a calculation: files that it lists, and layers and channels of the view
/// that it is applied to.
///
/// # Errors
/// If a file cannot be read or aligned, or a name is unknown or ambiguous.
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
                    let expected = "an expression that uses all files";
                    return Err(Error::invalid(
                        "calculation",
                        format!("the unused file `{}`", file.name),
                        expected,
                    ));
                }
            }
            (vec![expression.clone()], operands)
        }
        Formula::Reduction(reducer) => {
            let mut operands = Vec::new();
            for (tree, named) in base.iter().chain(&files).enumerate() {
                // (Opacity is not a band.)
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

/// Scales of operands.
fn scales(operands: &[Operand], trees: &[View]) -> Vec<Linear> {
    let scale = |operand: &Operand| Scale::of(trees[operand.tree].source().metadata(), operand.channel);
    let first = operands.first().map(scale);
    let linear = |operand: &Operand| {
        let own = scale(operand);
        first.as_ref().and_then(|first| own.to_unit_of(first)).unwrap_or(own.plain_numbers())
    };
    operands.iter().map(linear).collect()
}

/// Channel that a single name refers to: a layer of that name, or a channel of that name; else, if
/// it contains a point, a layer's channel.
fn find_channel(name: &str, base: &[Named]) -> Result<Operand> {
    let whole =
        |name: &str, channel: Option<&str>| Name { whole: name.into(), channel: channel.map(Into::into) };
    let is_layer = base.iter().any(|layer| layer.name == name);
    let parts =
        name.rsplit_once('.').filter(|(layer, _)| !is_layer && base.iter().any(|other| other.name == *layer));
    let name = parts.map_or_else(|| whole(name, None), |(layer, channel)| whole(layer, Some(channel)));
    find(&name, base, &[])
}

/// The view with the sampling of files: several source cells are combined by the rule.
fn by_rule(view: View) -> View {
    let rule = view.source().header().rule;
    let is_nearest = view.warp().resampling == Some(Resampling::Nearest);
    // (Sampling never fails for an existing view.)
    if is_nearest { view } else { view.clone().sampled(Sampling::Area(rule)).unwrap_or(view) }
}

fn open(name: &str, path: &Path, view: &View) -> Result<Named> {
    let file = TreeFile::open_only(path, &view.source().access().into())?;
    let (form, expected) = (file.form(), view.form());
    if form.dimension != expected.dimension {
        let expected = format!("{}, like {}", expected.dimension.tree_name(), view.source().name().display());
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
        let expected = format!("{}; or a file after the expression: {}=FILE", names.join(", "), name.whole);
        Err(Error::invalid("name in a calculation", found, expected))
    };
    let trees = || base.iter().chain(files).enumerate();
    // Files that the calculation lists come first, so that no band's name hides them; then layers.
    let tree = trees()
        .skip(base.len())
        .chain(trees().take(base.len()))
        .find(|(_, named)| named.name == name.whole && !named.name.is_empty());
    match (tree, &name.channel) {
        (Some((tree, named)), Some(channel)) => match channel_of(channel, &named.view)? {
            Some(channel) => Ok(Operand { tree, channel }),
            None => {
                let path = named.view.source().name().display();
                let expected = format!("one of the file's channels: {}", names_of(&named.view).join(", "));
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
                let found = format!("`{}`, which has {} channels", name.whole, channels(&named.view));
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
                    let expected = "a channel name that only one layer has, or LAYER.CHANNEL";
                    return Err(Error::invalid(
                        "name in a calculation",
                        format!("`{}`, which several layers have", name.whole),
                        expected,
                    ));
                }
            }
            // Channel numbers count the channels of all layers, consecutively.
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

/// All known names.
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

/// Channel, from 0, of the names `b1`, `b2`, ...
fn number_of(name: &str) -> Option<usize> {
    let digits =
        name.strip_prefix('b').filter(|digits| digits.bytes().all(|digit| digit.is_ascii_digit()))?;
    digits.parse::<usize>().ok()?.checked_sub(1)
}

/// Channel of a view by its band's name, or by its number.
fn channel_of(name: &str, view: &View) -> Result<Option<usize>> {
    let by_name = channel_by_name(name, view.source().metadata())?;
    Ok(by_name.or_else(|| number_of(name).filter(|channel| *channel < channels(view))))
}

fn channel_by_name(name: &str, metadata: &Metadata) -> Result<Option<usize>> {
    let mut named = metadata.band_names.iter().enumerate().filter(|(_, band)| *band == name);
    match (named.next(), named.next()) {
        (Some((first, _)), Some((second, _))) => {
            let found = format!("`{name}`, the name of channels {} and {}", first + 1, second + 1);
            Err(Error::invalid(
                "name in a calculation",
                found,
                "a name that only one channel has, or b1, b2, ...",
            ))
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

/// Aligns all trees with the first one's cells, over the extent of all. Classes keep their numbers,
/// since expressions use these.
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
    /// Value type of an operand's tree, and its channel.
    pub(super) fn channel(&self, operand: usize) -> (ValueType, usize) {
        let Operand { tree, channel } = self.operands[operand];
        (self.trees[tree].form().value, channel)
    }

    /// Whether a tree has operands; other trees are not read.
    pub(super) fn is_read(&self, tree: usize) -> bool {
        self.operands.iter().any(|operand| operand.tree == tree)
    }

    /// Trees of the operands.
    pub(super) fn read(&self) -> impl Iterator<Item = &View> {
        self.operands.iter().map(|operand| &self.trees[operand.tree])
    }
}
