//! Poses the nodes of a file for a given time: evaluates the animations of the file (glTF 2.0, section 3.11).

use std::collections::{BTreeSet, HashMap};

use ::gltf::json::scene::UnitQuaternion;
use glam::{DQuat, DVec4};
use serde::Deserialize;

use super::Checked;
use super::accessor::{ANIMATED, FLOAT, Format};
use super::document::{Document, Warnings};

/// Which animations to play, and the time of the pose.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Playback<'a> {
    /// Seconds since the start of the animations; `None`: the nodes keep the transforms in the file.
    pub at: Option<f64>,
    /// Name of the animation; `None` plays all of them together, and `none` plays none.
    pub animation: Option<&'a str>,
}

/// The name with which the nodes keep their transforms in the file, and without a warning.
const NONE: &str = "none";
/// A time may be outside the animations by this fraction of their length. The times of keys are rounded to f32, so the last key may
/// be slightly before the last frame.
pub const ROUNDING: f64 = 1e-6;
/// Maximum number of key values read from a file. For larger files the maximum is the number of bytes in its buffers.
const MAX_NUMBERS: u64 = 1 << 26;

#[derive(Deserialize)]
struct Animation {
    channels: Vec<Channel>,
    samplers: Vec<Sampler>,
}

#[derive(Deserialize)]
struct Channel {
    sampler: usize,
    target: Target,
}

#[derive(Deserialize)]
struct Target {
    #[serde(default)]
    node: Option<usize>,
    path: String,
}

#[derive(Deserialize)]
struct Sampler {
    input: usize,
    output: usize,
    #[serde(default)]
    interpolation: Interpolation,
}

#[derive(Deserialize, Default, Clone, Copy, PartialEq)]
#[serde(rename_all = "UPPERCASE")]
enum Interpolation {
    #[default]
    Linear,
    Step,
    CubicSpline,
}

/// The property of a node that a channel changes.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Property {
    Translation,
    Rotation,
    Scale,
    Weights,
}

impl Property {
    /// The number of components of a value; `None` if the mesh decides it.
    fn components(self) -> Option<usize> {
        match self {
            Property::Translation | Property::Scale => Some(3),
            Property::Rotation => Some(4),
            Property::Weights => None,
        }
    }
}

/// A property of a node as a function of time.
struct Curve {
    /// Times of the keys in seconds, in ascending order; never empty.
    times: Vec<f32>,
    /// One value per time; for cubic splines three: in-tangent, value, out-tangent. A value has `components` numbers.
    values: Vec<f32>,
    components: usize,
    interpolation: Interpolation,
    property: Property,
}

/// The animations, evaluated at one time.
struct Evaluated {
    /// The values of all animated properties, by node.
    values: HashMap<(usize, Property), Vec<f32>>,
    /// Time of the last key in seconds.
    end: f64,
}

/// Names of the nodes that move if animations change `nodes`: these nodes, all nodes below them, and nodes whose skin has a joint
/// that moves.
fn moving<'a>(doc: &Document, nodes: impl Iterator<Item = &'a usize>) -> BTreeSet<String> {
    let all = &doc.root.nodes;
    let mut moves = vec![false; all.len()];
    let mut open: Vec<usize> = nodes.copied().collect();
    while let Some(index) = open.pop() {
        if let Some(node) = all.get(index)
            && !std::mem::replace(&mut moves[index], true)
        {
            open.extend(node.children.iter().flatten().map(|child| child.value()));
        }
    }
    let moves_at = |index: usize| moves.get(index) == Some(&true);
    let skins = doc.root.skins.iter();
    // Once per skin: many nodes may share a skin of many joints.
    let deformed: Vec<bool> = skins.map(|skin| skin.joints.iter().any(|joint| moves_at(joint.value()))).collect();
    let has_moving_skin = |index: usize| {
        let skin = all[index].skin.as_ref();
        skin.is_some_and(|skin| deformed.get(skin.value()) == Some(&true))
    };
    (0..all.len()).filter(|&index| moves[index] || has_moving_skin(index)).map(|index| doc.node_name(index)).collect()
}

/// Sets translation, rotation, scale and weights of the nodes to their values at the time of `playback`. Without a time, the nodes
/// stay as they are; if the file has animations, the user gets a warning. Fails if `playback` has an animation but no time, or if that
/// animation does not exist. Also fails if no node moves, if the time is not between 0 and the end of the animations, or if an
/// animation is not valid. Returns [`super::Scene::moving`].
pub fn pose(doc: &mut Document, playback: Playback, warnings: &mut Warnings) -> Checked<Option<BTreeSet<String>>> {
    if is_none(doc, playback.animation) {
        return match playback.at {
            None => Ok(None),
            Some(_) => Err("has no pose at a time without animations; leave out --animation none".into()),
        };
    }
    let Some(time) = playback.at else {
        if let Some(name) = playback.animation {
            return Err(format!("the animation '{name}' needs a time: add --at or --frames"));
        }
        if !doc.root.animations.is_empty() {
            warnings.once("animations", || {
                "animations are only played with --at or --frames; nodes keep the transforms in the file".into()
            });
        }
        return Ok(None);
    };
    let Evaluated { values, end } = evaluate(doc, &chosen(doc, playback.animation)?, time, warnings)?;
    if values.is_empty() {
        return Err(nothing_moves(playback.animation));
    }
    let slack = ROUNDING * end;
    if !(-slack..=end + slack).contains(&time) {
        return Err(format!("has animations from 0 s to {end} s, so it has no pose at {time} s; choose a time inside"));
    }
    let moving = moving(doc, values.keys().map(|(node, _)| node));
    for ((node, property), value) in values {
        let target = &mut doc.root.nodes[node];
        let three = || [value[0], value[1], value[2]];
        match property {
            Property::Translation => target.translation = Some(three()),
            Property::Rotation => target.rotation = Some(UnitQuaternion([value[0], value[1], value[2], value[3]])),
            Property::Scale => target.scale = Some(three()),
            Property::Weights => target.weights = Some(value),
        }
    }
    Ok(Some(moving))
}

/// Time in seconds of the last key of the animations, or of the animation `name`; `None` if the file has no animation that moves a
/// node. Fails if `name` does not exist or moves no node, or if an animation is not valid.
pub fn end(doc: &Document, name: Option<&str>) -> Checked<Option<f64>> {
    if is_none(doc, name) || (doc.root.animations.is_empty() && name.is_none()) {
        return Ok(None);
    }
    let Evaluated { values, end } = evaluate(doc, &chosen(doc, name)?, 0.0, &mut Warnings::default())?;
    match name {
        Some(_) if values.is_empty() => Err(nothing_moves(name)),
        _ => Ok((!values.is_empty()).then_some(end)),
    }
}

/// Whether the user wants no animation: the name is [`NONE`], and no animation has this name.
fn is_none(doc: &Document, name: Option<&str>) -> bool {
    name == Some(NONE) && !doc.root.animation_labels().iter().any(|label| label == NONE)
}

/// The message, with the remedy, for animations that move no node: the animation `name`, or all of the file.
fn nothing_moves(name: Option<&str>) -> String {
    match name {
        Some(name) => format!("the animation '{name}' moves no node; leave out --animation"),
        None => "has animations that move no node; render it without --at and --frames".into(),
    }
}

/// The animations to play, with their labels.
fn chosen(doc: &Document, name: Option<&str>) -> Checked<Vec<(String, Animation)>> {
    if doc.root.animations.is_empty() {
        return Err("has no animations, so it has no pose at a time; render it without --at and --frames".into());
    }
    let labels = doc.root.animation_labels();
    let mut all = vec![];
    for (label, json) in labels.iter().zip(&doc.root.animations) {
        if name.is_none_or(|name| name == label) {
            let animation = serde_json::from_str(json.get())
                .map_err(|e| format!("animation `{label}` is not valid ({e}); re-export the file"))?;
            all.push((label.clone(), animation));
        }
    }
    if all.is_empty() {
        let (name, names) = (name.unwrap_or_default(), labels.join("', '"));
        return Err(format!("has no animation '{name}'; choose one of '{names}'"));
    }
    Ok(all)
}

/// Evaluates the curves of all channels at `time`. Fails if two animations move the same property of a node. Each curve is dropped
/// before the next one is read. Many channels may share the keys of one accessor, so all curves may be much larger than the file.
fn evaluate(
    doc: &Document,
    animations: &[(String, Animation)],
    time: f64,
    warnings: &mut Warnings,
) -> Checked<Evaluated> {
    let mut evaluated = Evaluated { values: HashMap::new(), end: 0.0 };
    let mut mover: HashMap<(usize, Property), usize> = HashMap::new();
    let mut keys = Keys { doc, numbers: 0 };
    for (number, (label, animation)) in animations.iter().enumerate() {
        for channel in &animation.channels {
            let Some(property) = property(&channel.target.path) else {
                warnings.once("animated", || {
                    format!("animation `{label}` changes the {} of an object, which is not played", channel.target.path)
                });
                continue;
            };
            let Some(node) = channel.target.node else { continue };
            let name = doc.node_name(node);
            let target = doc.root.nodes.get(node).ok_or_else(|| {
                format!("animation `{label}` moves node {node}, which does not exist; re-export the file")
            })?;
            if target.matrix.is_some() {
                return Err(format!(
                    "animation `{label}` moves node `{name}`, which has a matrix instead of translation, rotation and scale; \
                     re-export the file"
                ));
            }
            if let Some(other) = mover.insert((node, property), number) {
                if other == number {
                    return Err(format!("animation `{label}` moves node `{name}` twice; re-export the file"));
                }
                let other = &animations[other].0;
                return Err(format!(
                    "the animations `{other}` and `{label}` both move node `{name}`; choose one with --animation, or stop all with \
                     --animation none"
                ));
            }
            let sampler = animation
                .samplers
                .get(channel.sampler)
                .ok_or_else(|| format!("animation `{label}` has no sampler {}; re-export the file", channel.sampler))?;
            let what = format!("animation `{label}` of node `{name}`");
            let curve = Curve::read(&mut keys, sampler, property, &what)?;
            evaluated.values.insert((node, property), curve.value(time));
            evaluated.end = evaluated.end.max(curve.times.last().copied().unwrap_or_default().into());
        }
    }
    Ok(evaluated)
}

fn property(path: &str) -> Option<Property> {
    match path {
        "translation" => Some(Property::Translation),
        "rotation" => Some(Property::Rotation),
        "scale" => Some(Property::Scale),
        "weights" => Some(Property::Weights),
        _ => None,
    }
}

/// Reads the keys of animations.
struct Keys<'a> {
    doc: &'a Document<'a>,
    /// Numbers read so far. A limit on the file size is not enough, because many channels may share one accessor.
    numbers: u64,
}

impl Keys<'_> {
    /// The components of all elements of an accessor.
    fn read<const N: usize>(&mut self, accessor: usize, what: &str, allowed: &[Format]) -> Checked<Vec<f32>> {
        self.numbers += N as u64 * self.doc.count(accessor, what)?;
        let limit = MAX_NUMBERS.max(self.doc.buffer_bytes);
        if self.numbers > limit {
            return Err(format!("the animations have more than {limit} numbers at the {what}; remove some of them"));
        }
        Ok(self.doc.vectors::<N>(accessor, what, allowed)?.into_flattened())
    }
}

impl Curve {
    fn read(keys: &mut Keys, sampler: &Sampler, property: Property, what: &str) -> Checked<Curve> {
        let times = keys.read::<1>(sampler.input, &format!("times of {what}"), FLOAT)?;
        if times.iter().any(|time| !time.is_finite() || *time < 0.0) {
            return Err(format!("{what} has a time that is negative or not finite; correct it and re-export"));
        }
        if !times.is_sorted_by(|a, b| a < b) {
            return Err(format!("{what} has times that are not in ascending order; correct them and re-export"));
        }
        let output = format!("values of {what}");
        let values = match property {
            Property::Translation | Property::Scale => keys.read::<3>(sampler.output, &output, FLOAT)?,
            Property::Rotation => keys.read::<4>(sampler.output, &output, ANIMATED)?,
            Property::Weights => keys.read::<1>(sampler.output, &output, ANIMATED)?,
        };
        if values.iter().any(|value| !value.is_finite()) {
            return Err(format!("{what} has a value that is not finite; correct it and re-export"));
        }
        let interpolation = sampler.interpolation;
        let per_time = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let components = property.components().unwrap_or(values.len() / (per_time * times.len()));
        if components == 0 || values.len() != components * per_time * times.len() {
            return Err(format!(
                "{what} has {} values for {} times; re-export the file",
                values.len() / components.max(1),
                times.len()
            ));
        }
        Ok(Curve { times, values, components, interpolation, property })
    }

    /// The value at `time`: before the first key the value of the first key, after the last key the value of the last key.
    /// Interpolated rotations have unit length, unless they are zero.
    fn value(&self, time: f64) -> Vec<f32> {
        // The times of keys are rounded to f32, so a key may be slightly after its frame. At this frame, it counts.
        let after = self.times.partition_point(|&t| t <= time as f32);
        let last = self.times.len() - 1;
        if after == 0 || after > last {
            return self.key(if after == 0 { 0 } else { last }).to_vec();
        }
        let (k, [t0, t1]) = (after - 1, [after - 1, after].map(|k| f64::from(self.times[k])));
        let s = ((time - t0) / (t1 - t0)).max(0.0);
        match self.interpolation {
            Interpolation::Step => self.key(k).to_vec(),
            Interpolation::Linear if self.property == Property::Rotation => slerp(self.key(k), self.key(k + 1), s),
            Interpolation::Linear => self.mix(&[(self.key(k), 1.0 - s), (self.key(k + 1), s)]),
            Interpolation::CubicSpline => {
                let (s2, s3) = (s * s, s * s * s);
                let (out_tangent, in_tangent) = (self.entry(3 * k + 2), self.entry(3 * (k + 1)));
                let mixed = self.mix(&[
                    (self.key(k), 2.0 * s3 - 3.0 * s2 + 1.0),
                    (out_tangent, (t1 - t0) * (s3 - 2.0 * s2 + s)),
                    (self.key(k + 1), 3.0 * s2 - 2.0 * s3),
                    (in_tangent, (t1 - t0) * (s3 - s2)),
                ]);
                if self.property == Property::Rotation { normalised(mixed) } else { mixed }
            }
        }
    }

    /// The value of a key, without tangents.
    fn key(&self, k: usize) -> &[f32] {
        match self.interpolation {
            Interpolation::CubicSpline => self.entry(3 * k + 1),
            Interpolation::Linear | Interpolation::Step => self.entry(k),
        }
    }

    /// Value or tangent number `i`.
    fn entry(&self, i: usize) -> &[f32] {
        &self.values[i * self.components..][..self.components]
    }

    /// A weighted sum.
    fn mix(&self, parts: &[(&[f32], f64)]) -> Vec<f32> {
        let of = |c: usize| parts.iter().map(|(value, weight)| f64::from(value[c]) * weight).sum::<f64>() as f32;
        (0..parts[0].0.len()).map(of).collect()
    }
}

/// Spherical interpolation of two quaternions along the shorter way.
fn slerp(a: &[f32], b: &[f32], s: f64) -> Vec<f32> {
    let quaternion = |v: &[f32]| DVec4::from_array([0, 1, 2, 3].map(|c| f64::from(v[c]))).normalize_or_zero();
    let (a, b) = (DQuat::from_vec4(quaternion(a)), DQuat::from_vec4(quaternion(b)));
    a.slerp(b, s).to_array().map(|x| x as f32).to_vec()
}

fn normalised(value: Vec<f32>) -> Vec<f32> {
    let length = value.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    value.into_iter().map(|x| if length > 0.0 { (f64::from(x) / length) as f32 } else { x }).collect()
}
