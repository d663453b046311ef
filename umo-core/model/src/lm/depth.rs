//! The depth network: samples the codes of one keyframe, one after the other, from a decoder state (SPEC
//! 2.13).
//!
//! All codes share a small set of weights, which should stay in a core's cache. So one thread computes all
//! codes of an avatar's keyframe, threads share the avatars, and the avatars of one thread go through the
//! network together. The bits of a row do not depend on this grouping.

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError, check_finite};
use umo_core_base::memory::filled;
use umo_core_base::team::Team;
use umo_kernels::attention::{HeadCache, attention_heads_f32};
use umo_kernels::gemm::Epilogue;
use umo_kernels::norm::rms_norm;
use umo_kernels::product::Bf16Form;
use umo_kernels::{Isa, Mat, MatMut};

use super::sampler::{Rank, Sampler};
use crate::config::{Config, PartSpec, Sampling, TemplateItem};
use crate::layout::FREE;
use crate::linear::{Compute, Linear, QuantScratch};
use crate::weights::{AlignedBox, Loader, Table};

/// Maximum number of tasks that one thread computes together. Their rows share each read of the weights; the
/// limit keeps a step of many avatars short.
const LANE_TASKS: usize = 8;
/// Maximum number of threads that share a step.
const MAX_LANES: usize = 16;
/// Rows of a task: with prompt and without.
const TASK_ROWS: usize = 2;

/// Name of the annotation that says the phase of a gesture (SPEC 2.12).
const INTENT: &str = "intent";

/// The network.
#[derive(Debug)]
pub struct DepthNet {
    /// `[d, d_model]`
    input: Linear,
    /// `[d, d_model]`: projection of the encoder's states at the keyframe's audio, if the network uses them.
    heard: Option<Linear>,
    /// Number of places in the audio that are projected: one, or one each for the face and the body.
    places: usize,
    /// `[codes of a keyframe, d]`
    position: Table,
    layers: Box<[Layer]>,
    norm: Box<[f32]>,
    eps: f32,
    /// The codes of a keyframe, in order.
    slots: Vec<Slot>,
    /// `[levels * codes, d]` of each part.
    embed: Vec<Table>,
    /// `[levels * codes, d]` of each part for the previous keyframe's codes, if the network uses them.
    before: Option<Vec<Table>>,
    heads: usize,
    d_ff: usize,
    /// Inputs of the widest product that takes them rounded to bf16; 0 without such a product.
    rounded: usize,
}

#[derive(Debug)]
struct Layer {
    attention_norm: Box<[f32]>,
    /// Queries, keys and values, `[3 d, d]`.
    projection: Linear,
    output: Linear,
    feed_forward_norm: Box<[f32]>,
    gate: Linear,
    up: Linear,
    down: Linear,
}

/// One code of a keyframe.
#[derive(Debug)]
struct Slot {
    part: usize,
    /// Row of its code 0 in the part's table.
    first: usize,
    head: Linear,
    sampling: Option<Sampling>,
    /// Number of the place in the audio whose encoder state it reads.
    place: usize,
    /// Whether it is the phase of a gesture.
    is_intent: bool,
}

/// One avatar's keyframe to sample.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// Number of the avatar in the batch.
    pub member: usize,
    /// Row of the avatar's decoder state.
    pub row: usize,
    /// Row of its state without a prompt, for guidance.
    pub unprompted: Option<usize>,
    /// Strength of the guidance.
    pub guidance: f32,
    /// Bias towards rest of the phase of a gesture, nats.
    pub rest: f32,
    /// Sampler of the codes.
    pub sampler: Sampler,
    /// Number of the chunk in its stream.
    pub chunk: u64,
    /// Number of the keyframe in its chunk.
    pub keyframe: u32,
}

impl Task {
    fn rows(&self) -> usize {
        1 + usize::from(self.unprompted.is_some())
    }
}

/// Scratch memory for sampling the keyframes of a batch.
#[derive(Debug)]
pub struct DepthScratch {
    lanes: Box<[Lane]>,
    /// Number of codes in a keyframe.
    codes: usize,
}

/// Scratch memory of one thread.
#[derive(Debug)]
struct Lane {
    /// Team of this thread alone: products within a lane are single-threaded.
    alone: Team,
    /// `[places, rows, d]`: the projected decoder states plus the projected encoder state of each place.
    given: Box<[f32]>,
    /// `[rows, d]`: the residual stream.
    hidden: Box<[f32]>,
    /// `[rows, max(d, d_model)]`
    normed: Box<[f32]>,
    /// `[rows, 3 d]`
    qkv: Box<[f32]>,
    /// `[rows, d]`
    context: Box<[f32]>,
    /// `[rows, d_ff]`
    inner: Box<[f32]>,
    /// `[layers, 2, rows, heads, codes of a keyframe, d / heads]`: a layer's keys, then its values.
    cache: AlignedBox<f32>,
    /// `[rows, maximum codes of a level]`
    logits: Box<[f32]>,
    ranks: Box<[Rank]>,
    /// `[rows, codes of a keyframe]`
    codes: Box<[u16]>,
    /// `[rows, codes of a keyframe]`: codes of the previous keyframe.
    before: Box<[u16]>,
    quant: QuantScratch,
}

impl DepthNet {
    /// Loads `depth.*`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor or key.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let loader = &loader.for_few_rows(true);
        let config = loader.file().config();
        let sizes = config.depth.as_ref().ok_or_else(|| LoadError::config("depth", "missing"))?;
        let (d, d_ff) = (sizes.d_model, sizes.d_ff);
        let layer = |i: usize| {
            let name = |which: &str| format!("depth.layers.{i}.{which}.weight");
            let inside = loader.alike(&[name("feed_forward.wi_0"), name("feed_forward.wi_1")])?;
            let projections = ["q", "k", "v"].map(|which| name(&format!("attention.{which}")));
            Ok(Layer {
                attention_norm: loader.vector(&name("attention_norm"), d)?,
                projection: loader.linear(&projections, &[d; 3], d)?,
                output: loader.linear(&[name("attention.o")], &[d], d)?,
                feed_forward_norm: loader.vector(&name("feed_forward_norm"), d)?,
                gate: inside.linear(&[name("feed_forward.wi_0")], &[d_ff], d)?,
                up: inside.linear(&[name("feed_forward.wi_1")], &[d_ff], d)?,
                down: loader.linear(&[name("feed_forward.wo")], &[d], d_ff)?,
            })
        };
        let (mut slots, mut embed, mut before) = (Vec::new(), Vec::new(), sizes.before.then(Vec::new));
        let places = config.heard_tokens().count().max(1);
        for (part, spec) in config.part_list().iter().enumerate() {
            let rows = spec.levels * spec.codes;
            embed.push(loader.table(&format!("depth.embed.{}.weight", spec.name), rows, d)?);
            if let Some(before) = &mut before {
                before.push(loader.table(&format!("depth.before.{}.weight", spec.name), rows, d)?);
            }
            for first in (0..rows).step_by(spec.codes) {
                let name = format!("depth.head.{}.weight", spec.name);
                let head = loader.linear_rows(&name, rows, first..first + spec.codes, d)?;
                let place = if spec.is_face(&config.face) { 0 } else { places - 1 };
                let is_intent = is_intent(spec);
                slots.push(Slot { part, first, head, sampling: spec.sampling, place, is_intent });
            }
        }
        let layers = (0..sizes.num_layers).map(layer).collect::<Result<Vec<_>, LoadError>>()?;
        let int8 = layers.iter().any(|layer| layer.projection.is_quantized());
        let round = |product: Linear| if int8 { product.rounded() } else { product };
        let layers: Box<[_]> = layers.into_iter().map(|layer| Layer { down: round(layer.down), ..layer }).collect();
        let state = |name: &str| loader.linear(&[format!("depth.{name}.weight")], &[d], config.lm.d_model).map(round);
        let input = state("input")?;
        let heard = sizes.heard.map(|_| state("heard")).transpose()?;
        let products = layers.iter().map(|layer| &layer.down).chain([&input]).chain(&heard);
        let rounded =
            products.filter(|product| product.bf16_form(loader.isa()) == Some(Bf16Form::Rounded)).map(Linear::inputs);
        Ok(Self {
            rounded: rounded.max().unwrap_or(0),
            input,
            heard,
            places,
            position: loader.table("depth.position.weight", slots.len(), d)?,
            layers,
            norm: loader.vector("depth.norm.weight", d)?,
            eps: sizes.layer_norm_epsilon,
            slots,
            embed,
            before,
            heads: sizes.num_heads,
            d_ff,
        })
    }

    /// Number of codes in a keyframe.
    pub fn codes(&self) -> usize {
        self.slots.len()
    }

    /// Bytes of weights that one code of a keyframe reads, except its head. They should fit a core's cache.
    pub fn bytes(&self) -> usize {
        let layer =
            |l: &Layer| l.projection.bytes() + l.output.bytes() + l.gate.bytes() + l.up.bytes() + l.down.bytes();
        self.layers.iter().map(layer).sum()
    }

    /// Multiply-adds of one keyframe's codes.
    fn work(&self) -> usize {
        let (d, codes) = (self.norm.len(), self.slots.len());
        codes * self.layers.len() * (4 * d * d + 3 * d * self.d_ff)
    }

    /// Allocates scratch for batches of `width` avatars.
    pub fn scratch(&self, width: usize) -> DepthScratch {
        let lanes = width.min(MAX_LANES);
        DepthScratch {
            lanes: (0..lanes).map(|_| Lane::new(self, TASK_ROWS * width.min(LANE_TASKS))).collect(),
            codes: self.codes(),
        }
    }

    /// Samples `codes` of as many of the first `tasks` as there is room for, and returns their number. Calls
    /// with the same tasks can split a keyframe into consecutive ranges of `codes`, starting at 0. Never
    /// allocates.
    ///
    /// Shapes:
    /// - `states [rows, d_model]`: the decoder's states after its final norm.
    /// - `heard [rows, places, d_model]`: the encoder's states at the keyframe's audio, for the face and, if
    ///   that is another place, for the body. Zeros if there are none; empty if the network does not use
    ///   them.
    /// - `before [tasks, codes of a keyframe]`: the keyframe before each task's.
    /// - `wanted`, of the same shape: codes that are not drawn but set, [`FREE`] for the others.
    ///
    /// After the last code, `write(task, codes)` receives each task's codes in the order of the config's
    /// parts, levels ascending.
    ///
    /// # Errors
    /// [`StepError`] if logits are not finite, or `before` does not match the number of tasks.
    pub fn draw(
        &self,
        cx: Compute,
        scratch: &mut DepthScratch,
        (states, heard): (&[f32], &[f32]),
        (tasks, before, wanted): (&[Task], &[u16], &[u16]),
        codes: Range<usize>,
        mut write: impl FnMut(&Task, &[u16]),
    ) -> Result<usize, StepError> {
        if [before, wanted].iter().any(|codes| codes.len() != tasks.len() * self.codes()) {
            return Err(StepError::Disagree("tasks and codes of the keyframes before them"));
        }
        let groups = scratch.lanes.len().min(cx.team.threads()).min(tasks.len()).max(1);
        let count = tasks.len().min(groups * LANE_TASKS);
        let bounds = |group: usize| group * count / groups;
        let lanes = &mut scratch.lanes[..groups];
        cx.team.split(
            lanes,
            groups,
            1,
            count * self.work() * codes.len() / self.codes(),
            |lanes, at| lanes.split_at_mut(at),
            |range, lanes| {
                for (lane, group) in lanes.iter_mut().zip(range) {
                    let mine = bounds(group)..bounds(group + 1);
                    let [before, wanted] =
                        [before, wanted].map(|codes| &codes[mine.start * self.codes()..mine.end * self.codes()]);
                    lane.draw(self, cx.isa, (states, heard), (&tasks[mine], before, wanted), codes.clone())?;
                }
                Ok(())
            },
        )?;
        if codes.end < self.codes() {
            return Ok(count);
        }
        for (group, lane) in scratch.lanes[..groups].iter().enumerate() {
            let mut row = 0;
            for task in &tasks[bounds(group)..bounds(group + 1)] {
                write(task, &lane.codes[row * scratch.codes..(row + 1) * scratch.codes]);
                row += task.rows();
            }
        }
        Ok(count)
    }

    /// Computes logits under teacher forcing, for checking a model. Each code of
    /// `codes [rows, codes of a keyframe]` is predicted from the codes before it and from `before`, the
    /// previous keyframes, of the same shape. Returns one vector `[rows, codes of the level]` per code of a
    /// keyframe. Allocates.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees or a code is out of range.
    pub fn force(
        &self,
        isa: Isa,
        (states, heard): (&[f32], &[f32]),
        codes: &[u16],
        before: &[u16],
    ) -> Result<Vec<Vec<f32>>, StepError> {
        let (rows, count) = (codes.len() / self.codes(), self.codes());
        let is_whole = |states: &[f32], each: usize| states.len() == rows * each * self.input.inputs();
        let is_heard = self.heard.is_none() || is_whole(heard, self.places);
        if rows == 0 || rows * count != codes.len() || !is_whole(states, 1) || !is_heard {
            return Err(StepError::Disagree("states and codes of another number of keyframes"));
        }
        let mut lane = Lane::new(self, rows);
        if self.before.is_some() {
            if before.len() != codes.len() {
                return Err(StepError::Disagree("codes of keyframes and of those before them"));
            }
            for (&code, slot) in before.iter().zip(self.slots.iter().cycle()) {
                let limit = slot.head.outputs();
                if usize::from(code) >= limit {
                    return Err(StepError::OutOfRange { what: "motion code", got: code.into(), limit });
                }
            }
            lane.before.copy_from_slice(before);
        }
        let mut logits = vec![Vec::new(); count];
        lane.project(self, isa, (states, heard), 0..rows)?;
        for (j, out) in logits.iter_mut().enumerate() {
            lane.step(self, isa, j, rows)?;
            out.extend_from_slice(&lane.logits[..rows * self.slots[j].head.outputs()]);
            for row in 0..rows {
                let (code, limit) = (codes[row * count + j], self.slots[j].head.outputs());
                if usize::from(code) >= limit {
                    return Err(StepError::OutOfRange { what: "motion code", got: code.into(), limit });
                }
                lane.codes[row * count + j] = code;
            }
        }
        Ok(logits)
    }
}

impl Lane {
    fn new(net: &DepthNet, rows: usize) -> Self {
        let (d, codes) = (net.norm.len(), net.slots.len());
        let most = net.slots.iter().map(|slot| slot.head.outputs()).max().unwrap_or(0);
        let widest = d.max(net.input.inputs());
        let room = |cols: usize| filled(0.0, rows * cols).into_boxed_slice();
        Self {
            alone: Team::alone(),
            given: room(net.places * d),
            hidden: room(d),
            normed: room(widest),
            qkv: room(3 * d),
            context: room(d),
            inner: room(net.d_ff),
            cache: AlignedBox::zeroed(rows * net.layers.len() * 2 * d * codes),
            logits: room(most),
            ranks: filled(Rank::default(), most).into(),
            codes: filled(0, rows * codes).into(),
            before: filled(0, rows * codes).into(),
            quant: QuantScratch::new(rows, widest.max(net.d_ff)).with_parts([rows * net.rounded, 0]),
        }
    }

    /// Samples the codes `drawn` of every task but those `wanted`; `before` holds the codes of the previous keyframes.
    fn draw(
        &mut self,
        net: &DepthNet,
        isa: Isa,
        states: (&[f32], &[f32]),
        (tasks, before, wanted): (&[Task], &[u16], &[u16]),
        drawn: Range<usize>,
    ) -> Result<(), StepError> {
        let count = net.slots.len();
        let rows = tasks.iter().map(Task::rows).sum();
        if drawn.start == 0 {
            let of_rows = tasks.iter().zip(before.chunks_exact(count));
            let of_rows = of_rows.flat_map(|(task, before)| std::iter::repeat_n(before, task.rows()));
            self.before.chunks_exact_mut(count).zip(of_rows).for_each(|(row, before)| row.copy_from_slice(before));
            self.project(net, isa, states, tasks.iter().flat_map(|t| std::iter::once(t.row).chain(t.unprompted)))?;
        }
        for (j, slot) in net.slots.iter().enumerate().take(drawn.end).skip(drawn.start) {
            self.step(net, isa, j, rows)?;
            let (mut row, codes) = (0, slot.head.outputs());
            check_finite(&self.logits[..rows * codes], "depth network's logits")?;
            for (task, wanted) in tasks.iter().zip(wanted.chunks_exact(count)) {
                let (logits, below) = self.logits[row * codes..].split_at_mut(codes);
                if task.unprompted.is_some() {
                    guide(logits, &below[..codes], task.guidance);
                }
                if slot.is_intent {
                    lean(logits, task.rest);
                }
                #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
                let place = [task.keyframe, j as u32 + 1];
                #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
                let code = match wanted[j] {
                    FREE => task.sampler.of(slot.sampling).sample_at(logits, &mut self.ranks, task.chunk, place) as u16,
                    code => code,
                };
                for row in row..row + task.rows() {
                    self.codes[row * count + j] = code;
                }
                row += task.rows();
            }
        }
        Ok(())
    }

    /// Projects the decoder's states of `rows`, and the encoder's if the network uses them.
    fn project(
        &mut self,
        net: &DepthNet,
        isa: Isa,
        (states, heard): (&[f32], &[f32]),
        rows: impl Iterator<Item = usize> + Clone,
    ) -> Result<(), StepError> {
        let (d, width, cx) = (net.norm.len(), net.input.inputs(), Compute { isa, team: &self.alone });
        let each_place = self.given.len() / net.places;
        let Self { normed, quant, given, .. } = self;
        // Each row has `each` adjacent states; `one` selects one of them.
        let mut add = |input: &Linear, states: &[f32], (each, one): (usize, usize), epilogue, given: &mut [f32]| {
            let mut count = 0;
            for (out, row) in normed.chunks_exact_mut(width).zip(rows.clone()) {
                let state = states.chunks_exact(width).nth(row * each + one);
                out.copy_from_slice(state.ok_or(StepError::Disagree("states and rows of keyframes"))?);
                count += 1;
            }
            let x = Mat::new(normed, count, width)?;
            input.forward(cx, quant, x, epilogue, MatMut::new(given, count, d)?)
        };
        add(&net.input, states, (1, 0), Epilogue::STORE, &mut given[..each_place])?;
        let Some(input) = &net.heard else { return Ok(()) };
        let (first, others) = given.split_at_mut(each_place);
        for (place, given) in others.chunks_exact_mut(each_place).enumerate() {
            given.copy_from_slice(first);
            add(input, heard, (net.places, place + 1), Epilogue::ADD, given)?;
        }
        add(input, heard, (net.places, 0), Epilogue::ADD, first)
    }

    /// Computes the logits of code `j`, `[rows, codes of its level]`, from the states and the earlier codes.
    fn step(&mut self, net: &DepthNet, isa: Isa, j: usize, rows: usize) -> Result<(), StepError> {
        let (d, count) = (net.norm.len(), net.slots.len());
        let given = self.given.chunks_exact(self.given.len() / net.places).nth(net.slots[j].place).unwrap_or_default();
        for (row, (hidden, given)) in self.hidden.chunks_exact_mut(d).zip(given.chunks_exact(d)).enumerate() {
            if row == rows {
                break;
            }
            hidden.copy_from_slice(given);
            if let Some(before) = j.checked_sub(1) {
                let slot = &net.slots[before];
                net.embed[slot.part].add(slot.first + usize::from(self.codes[row * count + before]), hidden);
            }
            net.position.add(j, hidden);
            if let Some(before) = &net.before {
                let slot = &net.slots[j];
                before[slot.part].add(slot.first + usize::from(self.before[row * count + j]), hidden);
            }
        }
        for (index, layer) in net.layers.iter().enumerate() {
            self.attend(net, isa, (index, layer), j, rows)?;
            self.feed_forward(net, isa, layer, rows)?;
        }
        let (x, head) = (Mat::new(&self.hidden, rows, d)?, &net.slots[j].head);
        rms_norm(isa, x, &net.norm, net.eps, MatMut::new(&mut self.normed, rows, d)?)?;
        let (cx, x) = (Compute { isa, team: &self.alone }, Mat::new(&self.normed, rows, d)?);
        let y = MatMut::new(&mut self.logits, rows, head.outputs())?;
        head.forward(cx, &mut self.quant, x, Epilogue::STORE, y)
    }

    /// Causal attention of code `j`'s rows over the codes up to and including it.
    #[expect(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
    fn attend(
        &mut self,
        net: &DepthNet,
        isa: Isa,
        (index, layer): (usize, &Layer),
        j: usize,
        rows: usize,
    ) -> Result<(), StepError> {
        let (d, count) = (net.norm.len(), net.slots.len());
        let (width, cx) = (d / net.heads, Compute { isa, team: &self.alone });
        let x = Mat::new(&self.hidden, rows, d)?;
        rms_norm(isa, x, &layer.attention_norm, net.eps, MatMut::new(&mut self.normed, rows, d)?)?;
        let x = Mat::new(&self.normed, rows, d)?;
        layer.projection.forward(cx, &mut self.quant, x, Epilogue::STORE, MatMut::new(&mut self.qkv, rows, 3 * d)?)?;
        let scale = 1.0 / (width as f32).sqrt();
        let half = self.cache.len() / net.layers.len() / 2;
        let (keys, values) = self.cache[2 * index * half..2 * (index + 1) * half].split_at_mut(half);
        for (row, qkv) in self.qkv.chunks_exact(3 * d).take(rows).enumerate() {
            for (kept, new) in [&mut *keys, values].into_iter().zip(qkv[d..].chunks_exact(d)) {
                let kept = kept[row * d * count..][..d * count].chunks_exact_mut(count * width);
                for (kept, new) in kept.zip(new.chunks_exact(width)) {
                    kept[j * width..(j + 1) * width].copy_from_slice(new);
                }
            }
        }
        let cache = HeadCache { keys, values, heads: net.heads, places: count, filled: j + 1 };
        let q = Mat::with_stride(&self.qkv, rows, d, 3 * d)?;
        attention_heads_f32(isa, q, cache, scale, MatMut::new(&mut self.context, rows, d)?)?;
        let context = Mat::new(&self.context, rows, d)?;
        layer.output.forward(cx, &mut self.quant, context, Epilogue::ADD, MatMut::new(&mut self.hidden, rows, d)?)
    }

    fn feed_forward(&mut self, net: &DepthNet, isa: Isa, layer: &Layer, rows: usize) -> Result<(), StepError> {
        let (d, cx) = (net.norm.len(), Compute { isa, team: &self.alone });
        let x = Mat::new(&self.hidden, rows, d)?;
        rms_norm(isa, x, &layer.feed_forward_norm, net.eps, MatMut::new(&mut self.normed, rows, d)?)?;
        let x = layer.gate.input(cx, &mut self.quant, Mat::new(&self.normed, rows, d)?)?;
        let y = MatMut::new(&mut self.inner, rows, net.d_ff)?;
        layer.gate.apply_gated_here(&layer.up, isa, x, 0..net.d_ff, y)?;
        let inner = Mat::new(&self.inner, rows, net.d_ff)?;
        layer.down.forward(cx, &mut self.quant, inner, Epilogue::ADD, MatMut::new(&mut self.hidden, rows, d)?)
    }
}

/// `logits = plain + strength * (logits - plain)`.
fn guide(logits: &mut [f32], plain: &[f32], strength: f32) {
    for (logit, plain) in logits.iter_mut().zip(plain) {
        *logit = plain + strength * (*logit - plain);
    }
}

/// Weights of a bias towards rest in the phases of a gesture: rest, prepare, stroke, hold, retract. What hands hold or
/// take back ends by itself.
const TOWARDS_REST: [f32; 5] = [1.0, -1.0, -1.0, 0.0, 0.0];

/// Adds a bias towards rest, in nats, to the logits of `intent` (SPEC 2.21).
fn lean(logits: &mut [f32], rest: f32) {
    if rest == 0.0 {
        return;
    }
    for (code, logit) in logits.iter_mut().enumerate() {
        // Code 0 is rest, then each phase has three.
        *logit += rest * TOWARDS_REST[code.div_ceil(3).min(TOWARDS_REST.len() - 1)];
    }
}

/// Code of the phase of a gesture in which arms rest.
pub const REST: u16 = 0;

/// Index of the phase of a gesture among the codes of a keyframe.
pub fn intent(config: &Config) -> Option<usize> {
    let parts = config.parts.as_deref()?;
    let at = parts.iter().position(is_intent)?;
    Some(parts[..at].iter().map(|part| part.levels).sum())
}

fn is_intent(part: &PartSpec) -> bool {
    part.name == INTENT && part.is_annotation()
}

/// Whether sessions of a model can be guided: a depth network samples its keyframes, and one of its templates
/// takes a text.
pub fn is_guidable(config: &Config) -> bool {
    let text = |item: &TemplateItem| matches!(item, TemplateItem::Name(name) if name == "text");
    config.is_frames() && config.templates.values().flatten().any(text)
}
