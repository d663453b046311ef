//! Rounding of weights, calibrated on recordings: the float model animates them, and the Gram matrices of every
//! product's inputs determine how rounding errors can be compensated.

use std::io;
use std::path::PathBuf;
use std::thread;

use umo_core::{Animation, AvatarConfig, Compute, Isa, Model, ModelFile, Sampler, SessionConfig, Team};
use umo_core_model::calibration::Calibration;
use umo_core_model::weights::int4;
use umo_core_model::weights::writer::{Codes, Storage};
use umo_kernels::pack::{CODES_I4, GROUP};
use umo_kernels::quantize::quantize_weight_row;

use super::compensate::{Compensation, DAMPING};
use crate::failure::Failure;
use crate::speech::Speech;

/// Largest magnitude of an int8 code.
const STEPS: f64 = 127.0;

/// Animates `recordings` with the float model `file` and records the inputs of the products of the tensors `wanted`.
pub(super) fn run(file: &ModelFile, wanted: Vec<String>, recordings: &[PathBuf]) -> Result<Calibration, Failure> {
    let calibration = Calibration::new(wanted);
    let model = Model::load_recording(file, Isa::detect(), &calibration)?;
    let team = Team::new(1).map_err(Failure::environment)?;
    let (cx, config) = (Compute { isa: model.isa(), team: &team }, model.config());
    let mut seconds = 0.0;
    for (number, path) in recordings.iter().enumerate() {
        let speech = Speech::open(path, false)?;
        let defaults = SessionConfig::new(config).avatar;
        let sampler = Sampler { seed: number as u64, ..defaults.sampler };
        let avatar = AvatarConfig { horizon: config.audio.ahead, sampler, ..defaults };
        let mut animation = Animation::new(&model, &avatar)?;
        animation.hear(Box::new(speech.samples(config.audio.sample_rate)?), speech.frames(config.frame_rate)?);
        while animation.step(&model, cx, &mut |_| ())? {}
        seconds += speech.seconds();
    }
    eprintln!("note: calibrated by {seconds:.0} s of speech");
    Ok(calibration)
}

/// Returns the codes of the tensor `name` of `shape`; `values` are the float values used during calibration.
/// Rows without recorded inputs are rounded to nearest.
pub(super) fn codes(
    calibration: &Calibration,
    (name, shape): (&str, &[usize]),
    values: &[f32],
    storage: Storage,
) -> io::Result<Codes> {
    let (rows, width) = (shape[0], values.len() / shape[0].max(1));
    let mut by_row: Vec<Option<usize>> = vec![None; rows];
    let mut compensations = Vec::new();
    for (range, gram) in calibration.of(name) {
        let sum = gram.sum().map_err(io::Error::other)?;
        // A convolution reads its inputs in another order and is not recorded.
        if sum.len() == width * width
            && let Some(compensation) = Compensation::largest_first(&sum, width, DAMPING)
        {
            by_row[range].fill(Some(compensations.len()));
            compensations.push(compensation);
        }
    }
    let of_row = |row: usize| by_row[row].map(|at| &compensations[at]);
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let each = rows.div_ceil(threads).max(1);
    let parts = thread::scope(|scope| {
        let part = |first: usize| {
            move || {
                let mut codes = Codes { scale: Vec::new(), multipliers: Vec::new(), codes: Vec::new() };
                for row in first..(first + each).min(rows) {
                    round(&values[row * width..][..width], of_row(row), storage, &mut codes)?;
                }
                Ok(codes)
            }
        };
        let started: Vec<_> = (0..rows).step_by(each).map(|first| scope.spawn(part(first))).collect();
        let joined = started.into_iter().map(|part| part.join().unwrap_or_else(|_| Err(io::Error::other("a panic"))));
        joined.collect::<io::Result<Vec<Codes>>>()
    })?;
    let mut all = Codes { scale: Vec::new(), multipliers: Vec::new(), codes: Vec::new() };
    for part in parts {
        all.scale.extend(part.scale);
        all.multipliers.extend(part.multipliers);
        all.codes.extend(part.codes);
    }
    Ok(all)
}

/// Appends the codes of one row. For int8 the scale is that of plain rounding; for int4 the scales minimise the
/// weighted error. The codes are chosen by `compensation`, if present.
#[expect(clippy::cast_possible_truncation, reason = "rounded to a code")]
fn round(row: &[f32], compensation: Option<&Compensation>, storage: Storage, to: &mut Codes) -> io::Result<()> {
    let mut codes = vec![0; row.len()];
    if storage == Storage::Int4 {
        let mut multipliers = vec![0; row.len().div_ceil(GROUP)];
        let importance = compensation.map_or_else(|| vec![1.0; row.len()], Compensation::importance);
        let scale = int4::quantize_row(row, &importance, &mut codes, &mut multipliers);
        if let Some(compensation) = compensation {
            compensation.round(row, |i, value| {
                let step = f64::from(scale) * f64::from(multipliers[i / GROUP]);
                let code = if step == 0.0 { 0.0 } else { (value / step).round_ties_even() };
                let code = code.clamp(CODES_I4.0.into(), CODES_I4.1.into());
                codes[i] = code as i8;
                code * step
            });
        }
        to.scale.push(scale);
        to.multipliers.extend(multipliers);
    } else {
        let scale = quantize_weight_row(row, &mut codes).map_err(io::Error::other)?;
        if let Some(compensation) = compensation {
            let step = f64::from(scale);
            compensation.round(row, |i, value| {
                let code = (value / step).round_ties_even().clamp(-STEPS, STEPS);
                codes[i] = code as i8;
                code * step
            });
        }
        to.scale.push(scale);
    }
    to.codes.extend(codes);
    Ok(())
}
