//! `umo model inspect` and `umo inspect`: print the contents of a model, and of a character.

use std::collections::BTreeMap;

use umo_core::{Config, FaceKind, ModelFile};
use umo_core_model::config::AudioKind;
use umo_core_model::weights::layout;

use crate::args::{Inspect, InspectCharacter};
use crate::failure::Failure;
use crate::{model, retarget};

/// Prints a report on a character.
pub(crate) fn character(args: &InspectCharacter) -> Result<(), Failure> {
    let path = args.character.display();
    match retarget::is_inspected(&args.character) {
        true => retarget::inspect(&args.character),
        false => Err(Failure::input(format!(
            "{path}: expected a character, .glb, .gltf, .vrm or .bvh; `umo model inspect {path}` prints a model"
        ))),
    }
}

/// Prints a summary of a model.
pub(crate) fn run(args: &Inspect) -> Result<(), Failure> {
    if let Some(path) = args.model.as_deref().filter(|path| retarget::is_inspected(path)) {
        let path = path.display();
        return Err(Failure::input(format!("{path}: expected a model; `umo inspect {path}` prints a character")));
    }
    let file = model::open(args.model.as_deref())?;
    if args.config {
        println!("{}", serde_json::to_string_pretty(file.config()).map_err(Failure::environment)?);
        return Ok(());
    }
    if args.verify {
        match file.verify() {
            Ok(true) => println!("checksum   right"),
            Ok(false) => println!("checksum   none: the file cannot be verified"),
            Err(error) => return Err(error.into()),
        }
        return Ok(());
    }
    summary(file.config());
    sizes(&file);
    if args.tensors {
        println!();
        for (name, dtype, shape, bytes) in file.tensors() {
            println!("{name:<76} {dtype:>5} {bytes:>12} {shape:?}");
        }
    }
    Ok(())
}

fn audio(c: &Config) -> String {
    match (c.audio.kind, &c.audio.hubert, &c.audio.mel) {
        (AudioKind::Hubert, Some(h), _) => {
            format!("hubert, {} layers of {}, {} heads", h.num_hidden_layers, h.hidden_size, h.num_attention_heads)
        }
        (_, _, Some(m)) => {
            let layers = m.network.as_ref().map(|n| {
                let blocks = n.blocks.map(|b| format!(", {} blocks over {}", b.count, b.kernel));
                format!(", layers of {:?} on the last {}{}", n.widths, n.taps, blocks.unwrap_or_default())
            });
            format!("mel, {} bands, {} orders of differences{}", m.bands, m.deltas, layers.unwrap_or_default())
        }
        _ => "none".to_owned(),
    }
}

fn summary(c: &Config) {
    let face = match c.face.kind {
        FaceKind::Arkit => "ARKit blendshapes",
        FaceKind::SmplxExpression => "SMPL-X expression coefficients",
    };
    let (lm, i) = (&c.lm, &c.interp);
    println!("name       {}", c.name);
    println!("licence    {}", c.license);
    println!("audio      {}, {} units, {} a second", audio(c), c.audio.units, c.audio.token_rate);
    println!(
        "language   {} + {} layers of {}, {} heads of {}, {} experts of {}, top {}, vocabulary {}",
        lm.num_layers,
        lm.num_decoder_layers,
        lm.d_model,
        lm.num_heads,
        lm.d_kv,
        lm.experts,
        lm.d_ff,
        lm.top_k,
        c.vocab.size
    );
    println!("between    {} + {} layers of {}, {} heads", i.temporal_layers, i.part_layers, i.d_model, i.num_heads);
    if let Some(depth) = &c.depth {
        println!(
            "depth      {} layers of {}, {} heads, feed-forward {}, {} codes a keyframe{}{}{}",
            depth.num_layers,
            depth.d_model,
            depth.num_heads,
            depth.d_ff,
            c.codes_per_keyframe(),
            if depth.before { ", each knows the one before" } else { "" },
            if depth.heard.is_some() { ", hears its own audio" } else { "" },
            if depth.body_heard.is_some() { ", the body another token than the face" } else { "" }
        );
    }
    if c.parts.is_none() {
        println!("motion     codes of {}, {} {face}", c.vq.width, c.face.names.len());
    } else {
        let parts: Vec<_> = c.part_list().into_iter().map(|p| format!("{} {}x{}", p.name, p.levels, p.codes)).collect();
        println!("motion     {}; {} {face}", parts.join(", "), c.face.names.len());
    }
    println!(
        "chunk      {} keyframes from {}, one every {} frames at {} a second, {} frames of lookahead",
        c.target, c.prefix, c.keyframe_stride, c.frame_rate, c.lookahead
    );
    if let Some(m) = &c.mouth {
        let ahead = (1000 * m.ahead).div_ceil(m.rows * c.frame_rate);
        println!(
            "mouth      {} channels, {} blocks of {}, {ahead} ms ahead",
            m.channels.len(),
            m.dilations.len(),
            m.width
        );
    }
    let templates: Vec<_> = c.templates.keys().map(String::as_str).collect();
    println!("templates  {}", templates.join(", "));
}

/// Prints parameters and bytes per stage; a token activates only `top_k` of the experts.
fn sizes(file: &ModelFile) {
    let config = file.config();
    let bytes: BTreeMap<&str, usize> = file.tensors().into_iter().map(|(name, .., bytes)| (name, bytes)).collect();
    let mut stages: BTreeMap<String, [usize; 3]> = BTreeMap::new();
    for spec in layout::specs(config, true).iter().filter(|spec| file.has(&spec.name)) {
        let beside = |what: &str| bytes.get(format!("{}.{what}", spec.name).as_str()).copied().unwrap_or(0);
        let [parameters, active, size] = stages.entry(spec.stage().to_owned()).or_default();
        *parameters += spec.len();
        *active += if spec.is_expert() { spec.len() * config.lm.top_k / config.lm.experts } else { spec.len() };
        *size += beside("scale") + beside("multipliers") + bytes.get(spec.name.as_str()).copied().unwrap_or(0);
    }
    println!();
    println!("{:<10} {:>14} {:>14} {:>14}", "stage", "parameters", "active", "bytes");
    let mut total = [0; 3];
    for (stage, row) in &stages {
        println!("{stage:<10} {:>14} {:>14} {:>14}", row[0], row[1], row[2]);
        total.iter_mut().zip(row).for_each(|(total, value)| *total += value);
    }
    println!("{:<10} {:>14} {:>14} {:>14}", "all", total[0], total[1], total[2]);
    println!("{:<10} {:>44}", "file", file.len());
}
