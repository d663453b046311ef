//! Stages specific to layout `frames` (SPEC 3.1).

use umo_core_base::error::StepError;
use umo_core_model::config::{Config, PartSpec};
use umo_core_model::interp::vectors::VectorInterp;
use umo_core_model::layout::FREE;
use umo_core_model::linear::Compute;
use umo_core_model::lm::decoder::Sequence;
use umo_core_model::lm::depth::{DepthNet, Task};
use umo_core_model::lm::frames::FrameTables;
use umo_core_model::lm::{Lengths, Lm, LmScratch};
use umo_core_model::motion::MotionDecoder;
use umo_core_model::weights::Loader;
use umo_kernels::Mat;

use super::{Inputs, Options, Output, Stage, StageError, poses};

type Outputs = Result<Vec<Output>, StageError>;

/// Runs `stage` if layout `frames` has its own version of it.
pub(super) fn run(stage: Stage, cx: Compute, loader: &Loader, inputs: &Inputs, options: Options) -> Option<Outputs> {
    match stage {
        Stage::Hubert | Stage::Mel | Stage::Mouth => None,
        Stage::Encoder => Some(encoder(cx, loader, inputs)),
        Stage::Decoder => Some(decoder(cx, loader, inputs)),
        Stage::Generate => Some(generate(cx, loader, inputs, options)),
        Stage::Depth => Some(depth(cx, loader, inputs)),
        Stage::Interp => Some(interp(cx, loader, inputs)),
        Stage::Motion => Some(motion(cx, loader, inputs)),
    }
}

/// Joins codes `{group}.{part}` `[T, levels]` of all parts into `[T, codes of a keyframe]`.
fn keyframes(config: &Config, inputs: &Inputs, group: &str) -> Result<Vec<u16>, StageError> {
    let parts = config.part_list();
    let codes = parts.iter().map(|part| inputs.code_rows(&format!("{group}.{}", part.name), part.levels));
    let codes = codes.collect::<Result<Vec<_>, _>>()?;
    let frames = codes[0].len() / parts[0].levels;
    let mut all = Vec::with_capacity(frames * config.codes_per_keyframe());
    for frame in 0..frames {
        for (part, codes) in parts.iter().zip(&codes) {
            let row = codes.get(frame * part.levels..(frame + 1) * part.levels);
            all.extend_from_slice(row.ok_or(StepError::Disagree("the parts have different numbers of keyframes"))?);
        }
    }
    if all.len() != codes.iter().map(Vec::len).sum::<usize>() {
        return Err(StepError::Disagree("the parts have different numbers of keyframes").into());
    }
    Ok(all)
}

/// Splits codes `[T, codes of a keyframe]` into one output per part.
fn split(config: &Config, keyframes: &[u16]) -> Vec<Output> {
    let (parts, count, mut at) = (config.part_list(), config.codes_per_keyframe(), 0);
    let output = |part: PartSpec| {
        let rows = keyframes.chunks_exact(count).flat_map(|row| &row[at..at + part.levels]);
        let codes: Vec<i64> = rows.map(|&code| i64::from(code)).collect();
        at += part.levels;
        Output {
            shape: vec![codes.len() / part.levels, part.levels],
            ..Output::integers(&format!("codes.{}", part.name), codes)
        }
    };
    parts.into_iter().map(output).collect()
}

/// A model of layout `frames` with its encoder states of `input_ids` and `history`, and a sequence that attends to
/// them.
struct Encoded {
    lm: Lm,
    tables: FrameTables,
    scratch: LmScratch,
    hidden: Vec<f32>,
    rows: usize,
    lengths: Lengths,
    /// Row of the first audio token.
    audio: Option<usize>,
}

impl Encoded {
    fn new(cx: Compute, loader: &Loader, inputs: &Inputs, decoder: usize) -> Result<Self, StageError> {
        let config = loader.file().config();
        let (ids, history) = (inputs.ids("input_ids")?, keyframes(config, inputs, "history")?);
        let count = config.codes_per_keyframe();
        let (rows, given) = (ids.len(), history.len() / count);
        let lengths = Lengths { encoder: rows.max(1), decoder };
        let (lm, tables) = (Lm::load(loader, lengths)?, FrameTables::load(loader)?);
        // The row after the history is the decoder's.
        let mut scratch = LmScratch::with_given(config, rows.max(decoder), given + 1);
        for (row, codes) in history.chunks_exact(count).enumerate() {
            tables.history(codes, scratch.given_mut(row))?;
        }
        let mut hidden = vec![0.0; rows * lm.d_model()];
        lm.encode(cx, &mut scratch, &ids, &[rows], &mut hidden)?;
        let audio = ids.iter().position(|&id| id as usize == config.vocab.audio.start).map(|start| start + 1);
        Ok(Self { lm, tables, scratch, hidden, rows, lengths, audio })
    }

    /// Runs the decoder over `count` keyframes. `state(keyframe, state, heard)` receives each state, and the
    /// encoder's `[places, d_model]` at the keyframe's audio; it returns the keyframe's codes.
    fn decode(
        &mut self,
        cx: Compute,
        config: &Config,
        count: usize,
        mut state: impl FnMut(usize, &[f32], &[f32]) -> Result<Vec<u16>, StageError>,
    ) -> Result<(), StageError> {
        let Self { lm, tables, scratch, hidden, rows, lengths, audio } = self;
        let mut sequence = Sequence::new(config, *lengths, lm.cross_storage());
        lm.attend_to(cx, scratch, Mat::new(hidden, *rows, lm.d_model())?, &mut sequence)?;
        let row = scratch.given_rows() - 1;
        tables.start(scratch.given_mut(row));
        let id = u32::try_from(config.vocab.size + row).expect("rows of a stage are few");
        for keyframe in 0..count {
            sequence.set_ids(&[id])?;
            lm.decode(cx, scratch, std::slice::from_mut(&mut sequence))?;
            let (d, tokens) = (lm.d_model(), config.tokens_per_keyframe());
            let last = (config.prefix + count + config.audio.ahead) * tokens - 1;
            let mut heard = Vec::new();
            for token in config.heard_tokens() {
                let place = audio.map(|audio| audio + ((config.prefix + keyframe) * tokens + token).min(last));
                match place.filter(|place| *place < *rows) {
                    Some(place) => heard.extend_from_slice(&hidden[place * d..(place + 1) * d]),
                    None => heard.resize(heard.len() + d, 0.0),
                }
            }
            let codes = state(keyframe, &scratch.states()[..d], &heard)?;
            tables.keyframe(&codes, scratch.given_mut(row))?;
        }
        Ok(())
    }
}

fn encoder(cx: Compute, loader: &Loader, inputs: &Inputs) -> Outputs {
    let Encoded { lm, hidden, rows, .. } = Encoded::new(cx, loader, inputs, 1)?;
    Ok(vec![Output::floats("hidden", &[rows, lm.d_model()], hidden)])
}

fn decoder(cx: Compute, loader: &Loader, inputs: &Inputs) -> Outputs {
    let config = loader.file().config();
    let (codes, count) = (keyframes(config, inputs, "codes")?, config.codes_per_keyframe());
    let rows = codes.len() / count;
    let mut encoded = Encoded::new(cx, loader, inputs, rows.max(1))?;
    let mut states = Vec::new();
    encoded.decode(cx, config, rows, |keyframe, state, _| {
        states.extend_from_slice(state);
        Ok(codes[keyframe * count..(keyframe + 1) * count].to_vec())
    })?;
    Ok(vec![Output::floats("hidden", &[rows, config.lm.d_model], states)])
}

fn generate(cx: Compute, loader: &Loader, inputs: &Inputs, options: Options) -> Outputs {
    let config = loader.file().config();
    let target = options.target.unwrap_or(config.target);
    if !(1..=config.max_target).contains(&target) {
        return Err(StepError::OutOfRange { what: "target", got: target, limit: config.max_target + 1 }.into());
    }
    let net = DepthNet::load(loader)?;
    let (mut scratch, mut all) = (net.scratch(1), Vec::new());
    let mut before = keyframes(config, inputs, "history")?;
    let last = before.len().checked_sub(config.codes_per_keyframe()).ok_or(StepError::Empty("codes of history"))?;
    before.drain(..last);
    let free = vec![FREE; before.len()];
    Encoded::new(cx, loader, inputs, target)?.decode(cx, config, target, |keyframe, state, heard| {
        let keyframe = u32::try_from(keyframe).expect("chunks have few keyframes");
        let sampler = options.sampler;
        let task = Task { member: 0, row: 0, unprompted: None, guidance: 1.0, rest: 0.0, sampler, chunk: 0, keyframe };
        let mut drawn = Vec::new();
        let write = |_: &Task, codes: &[u16]| drawn.extend_from_slice(codes);
        net.draw(cx, &mut scratch, (state, heard), (&[task], &before, &free), 0..net.codes(), write)?;
        before.copy_from_slice(&drawn);
        all.extend_from_slice(&drawn);
        Ok(drawn)
    })?;
    Ok(split(config, &all))
}

fn depth(cx: Compute, loader: &Loader, inputs: &Inputs) -> Outputs {
    let config = loader.file().config();
    let net = DepthNet::load(loader)?;
    let states = inputs.float_rows("hidden", config.lm.d_model)?;
    let codes = keyframes(config, inputs, "codes")?;
    let before = if config.depth.as_ref().is_some_and(|depth| depth.before) {
        keyframes(config, inputs, "before")?
    } else {
        Vec::new()
    };
    // `[rows, places, d_model]`: one row of each input in turn.
    let names = ["heard", "body_heard"].into_iter().zip(config.heard_tokens());
    let places = names.map(|(name, _)| inputs.float_rows(name, config.lm.d_model)).collect::<Result<Vec<_>, _>>()?;
    if places.iter().any(|states| states.len() != places[0].len()) {
        return Err(StepError::Disagree("states that the face and the body hear").into());
    }
    let rows = (0..states.len()).step_by(config.lm.d_model);
    let heard: Vec<f32> = rows
        .flat_map(|at| places.iter().flat_map(move |states| states.get(at..at + config.lm.d_model).unwrap_or_default()))
        .copied()
        .collect();
    let mut logits = net.force(cx.isa, (&states, &heard), &codes, &before)?.into_iter();
    let rows = codes.len() / net.codes();
    let output = |part: PartSpec| {
        let levels: Vec<Vec<f32>> = logits.by_ref().take(part.levels).collect();
        let of = |row: usize| levels.iter().flat_map(move |level| level[row * part.codes..].iter().take(part.codes));
        let values = (0..rows).flat_map(of).copied().collect();
        Output::floats(&format!("logits.{}", part.name), &[rows, part.levels, part.codes], values)
    };
    Ok(config.part_list().into_iter().map(output).collect())
}

/// Parts with channels.
fn moving(config: &Config) -> Vec<PartSpec> {
    config.part_list().into_iter().filter(|part| !part.is_annotation()).collect()
}

fn interp(cx: Compute, loader: &Loader, inputs: &Inputs) -> Outputs {
    let (network, parts) = (VectorInterp::load(loader)?, moving(loader.file().config()));
    let known: Vec<bool> = inputs.integers("known")?.into_iter().map(|known| known != 0).collect();
    let rows = |part: &PartSpec| Ok(inputs.float_rows(&format!("vectors.{}", part.name), part.width)?.into());
    let mut vectors = parts.iter().map(rows).collect::<Result<Vec<Box<[f32]>>, StageError>>()?;
    network.fill(cx, &mut network.scratch(known.len()), &mut vectors, &known)?;
    let output = |(part, vectors): (&PartSpec, Box<[f32]>)| {
        Output::floats(&format!("vectors.{}", part.name), &[known.len(), part.width], vectors.into())
    };
    Ok(parts.iter().zip(vectors).map(output).collect())
}

fn motion(cx: Compute, loader: &Loader, inputs: &Inputs) -> Outputs {
    let (decoder, parts) = (MotionDecoder::load(loader)?, moving(loader.file().config()));
    let rows = |part: &PartSpec| inputs.code_rows(&format!("codes.{}", part.name), part.levels);
    let codes = parts.iter().map(rows).collect::<Result<Vec<_>, _>>()?;
    let codes: Vec<_> = codes.iter().map(Vec::as_slice).collect();
    Ok(poses(&decoder, &decoder.decode_list(cx, &codes)?))
}
