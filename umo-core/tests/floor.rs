//! Floors count the weights that are really in the files.

use std::path::PathBuf;

use umo_core::ModelFile;
use umo_core_tools::floor::{self, Stages, Stored};

/// Number of values in the matrices and convolutions whose names match.
fn weights(file: &ModelFile, wanted: impl Fn(&str) -> bool) -> usize {
    let products = file.tensors().into_iter().filter(|(name, _, shape, _)| shape.len() > 1 && wanted(name));
    products.map(|(_, _, shape, _)| shape.iter().product::<usize>()).sum()
}

#[test]
fn floors_read_every_weight_of_a_stage_once() {
    for name in ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit", "frames_seven"] {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name);
        let file = ModelFile::open(&folder.join("model.safetensors")).unwrap();
        let config = file.config();
        let stages = Stages::of(config, Stored::Int8, config.target);

        let attention = |name: &str| name.contains("Attention.") && !name.contains("relative_attention_bias");
        let of = |stack: &'static str| move |name: &str| name.starts_with(stack);
        let encoder = of("lm.encoder.block");
        assert_eq!(stages.encoder_attention.bytes, weights(&file, |n| encoder(n) && attention(n)), "{name}");
        let experts = weights(&file, |n| encoder(n) && n.contains(".experts."));
        assert_eq!(stages.encoder_experts.bytes, experts, "{name}");

        let frames = config.is_frames();
        let steps = if frames { config.target } else { 4 * config.target };
        let (codes, tokens) = (steps, floor::encoder_tokens(config, config.target));
        let lm = &config.lm;
        // Keys and values of the encoder's states are computed once; all else is read for every code.
        let decoder = of("lm.decoder.block");
        let made_once = |n: &str| n.contains("EncDecAttention.k") || n.contains("EncDecAttention.v");
        let once = weights(&file, |n| decoder(n) && made_once(n));
        let often = weights(&file, |n| decoder(n) && attention(n) && !made_once(n));
        // Int8 models keep them as bfloat16.
        let cached = 2 * 2 * tokens * lm.num_heads * lm.d_kv * lm.num_decoder_layers;
        let head = if frames { 0 } else { 2 * config.vq.codes * lm.d_model };
        assert_eq!(stages.cross.bytes, once, "{name}");
        assert_eq!(stages.decoder_attention.bytes, codes * (often + cached + head), "{name}");
        let experts = weights(&file, |n| decoder(n) && n.contains(".experts.")) / lm.experts * lm.top_k;
        assert_eq!(stages.decoder_experts.bytes, codes * experts, "{name}");

        let depth = |n: &str| n.starts_with("depth.") && !n.contains(".embed.") && !n.contains(".position.");
        assert_eq!(stages.depth.bytes, weights(&file, depth), "{name}");
        let interp = ["interp.temporal", "interp.part", "interp.head", "interp.input"];
        let interp = weights(&file, |n| interp.iter().any(|part| n.starts_with(part)));
        assert_eq!(stages.interp.bytes, interp, "{name}");
        let motion = weights(&file, |n| n.starts_with("vq.") && (n.contains(".decoder.") || n.contains(".root.")));
        assert_eq!(stages.motion.bytes, motion, "{name}");

        let centroids = 4 * weights(&file, |n| n.contains("kmeans"));
        let audio = match config.audio.kind {
            umo_core_model::config::AudioKind::Hubert => weights(&file, of("audio.hubert.")),
            umo_core_model::config::AudioKind::Mel => {
                let product =
                    |n: &str| n.ends_with(".weight") && (n.contains("mel.filters") || n.contains("mel.network"));
                4 * weights(&file, product)
            }
        };
        assert_eq!(stages.tokenizer.bytes, audio + centroids, "{name}");
    }
}

#[test]
fn the_encoder_reads_as_many_tokens_as_the_template_writes() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit");
    let file = ModelFile::open(&folder.join("model.safetensors")).unwrap();
    let config = file.config();
    let template = umo_core_model::lm::layout::Template::new(config, "audio_to_motion").unwrap();
    for target in 1..=config.max_target {
        let units = vec![0; umo_core_model::lm::layout::window_tokens(config, target)];
        let history = vec![0; config.prefix * umo_core::Part::ALL.len()];
        let mut ids = vec![0; umo_core_model::lm::layout::max_encoder_tokens(config)];
        let prompt = umo_core_model::lm::layout::Prompt { units: &units, history: &history, ..Default::default() };
        assert_eq!(floor::encoder_tokens(config, target), template.write(&prompt, &mut ids).unwrap());
    }
}
