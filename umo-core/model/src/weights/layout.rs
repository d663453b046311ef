//! All tensors that a config requires, with shape and kind (SPEC 3).

use umo_core_pose::part::Part;

use crate::config::{AudioKind, Config, Hubert, Mel, Mouth};

/// Kind of a tensor's values: determines random initialization, and whether they may be quantized.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Rows of a product; values of about `1 / sqrt(inputs)`.
    Product,
    /// A row per token, code or position, read by index.
    Table,
    /// Added to a product.
    Bias,
    /// Scale after a norm: about 1.
    Norm,
    /// A router: it makes decisions, so it stays in full precision.
    Router,
    /// Added to attention scores.
    PositionBias,
    /// Window, filters, mean and scale of mel features.
    Mel,
    /// A small layer after mel features. It stays in full precision: units depend on the centroid nearest to its
    /// output, or its output is the face.
    Listener,
    /// Centroids or a codebook, for nearest-neighbour search.
    Centroids,
}

/// One tensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spec {
    /// Name in the file.
    pub name: String,
    /// Shape.
    pub shape: Vec<usize>,
    /// Kind of its values.
    pub kind: Kind,
}

impl Spec {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of inputs of a product: values per output.
    pub fn inputs(&self) -> usize {
        self.shape.iter().skip(1).product()
    }

    /// Stage of the tensor: the first word of its name.
    pub fn stage(&self) -> &str {
        self.name.split('.').next().unwrap_or_default()
    }

    /// Whether the tensor belongs to one of several experts.
    pub fn is_expert(&self) -> bool {
        self.name.contains(".moe.experts.")
    }
}

/// All tensors of a model, in a fixed order; with `encoders` including those that only motion tokenization needs.
pub fn specs(config: &Config, encoders: bool) -> Vec<Spec> {
    let mut list = List(Vec::new());
    match (config.audio.kind, &config.audio.hubert, &config.audio.mel) {
        (AudioKind::Hubert, Some(hubert), _) => list.hubert(hubert, config.audio.units),
        (AudioKind::Mel, _, Some(mel)) => list.mel(mel, config.audio.units),
        _ => {}
    }
    list.lm(config);
    if config.is_frames() {
        list.depth(config);
        list.vector_interp(config);
    } else {
        list.interp(config);
    }
    list.vq(config, encoders);
    config.mouth.iter().for_each(|mouth| list.mouth(mouth));
    list.0
}

struct List(Vec<Spec>);

impl List {
    fn add(&mut self, name: impl Into<String>, shape: &[usize], kind: Kind) {
        self.0.push(Spec { name: name.into(), shape: shape.to_vec(), kind });
    }

    fn norm(&mut self, name: &str, width: usize) {
        self.add(format!("{name}.weight"), &[width], Kind::Norm);
        self.add(format!("{name}.bias"), &[width], Kind::Bias);
    }

    fn linear(&mut self, name: &str, outputs: usize, inputs: usize) {
        self.add(format!("{name}.weight"), &[outputs, inputs], Kind::Product);
        self.add(format!("{name}.bias"), &[outputs], Kind::Bias);
    }

    fn conv(&mut self, name: &str, outputs: usize, channels: usize, kernel: usize) {
        self.add(format!("{name}.weight"), &[outputs, channels, kernel], Kind::Product);
        self.add(format!("{name}.bias"), &[outputs], Kind::Bias);
    }

    fn hubert(&mut self, h: &Hubert, units: usize) {
        let (d, p) = (h.hidden_size, "audio.hubert");
        let mut channels = 1;
        for (i, (&dim, &kernel)) in h.conv_dim.iter().zip(&h.conv_kernel).enumerate() {
            let layer = format!("{p}.feature_extractor.conv_layers.{i}");
            self.add(format!("{layer}.conv.weight"), &[dim, channels, kernel], Kind::Product);
            if i == 0 {
                self.norm(&format!("{layer}.layer_norm"), dim);
            }
            channels = dim;
        }
        self.norm(&format!("{p}.feature_projection.layer_norm"), channels);
        self.linear(&format!("{p}.feature_projection.projection"), d, channels);
        let groups = h.num_conv_pos_embedding_groups;
        self.conv(&format!("{p}.encoder.pos_conv_embed.conv"), d, d / groups, h.num_conv_pos_embeddings);
        self.norm(&format!("{p}.encoder.layer_norm"), d);
        for i in 0..h.num_hidden_layers {
            let layer = format!("{p}.encoder.layers.{i}");
            for which in ["k_proj", "v_proj", "q_proj", "out_proj"] {
                self.linear(&format!("{layer}.attention.{which}"), d, d);
            }
            self.norm(&format!("{layer}.layer_norm"), d);
            self.linear(&format!("{layer}.feed_forward.intermediate_dense"), h.intermediate_size, d);
            self.linear(&format!("{layer}.feed_forward.output_dense"), d, h.intermediate_size);
            self.norm(&format!("{layer}.final_layer_norm"), d);
        }
        self.add("audio.kmeans.centroids", &[units, d], Kind::Centroids);
    }

    fn mel(&mut self, m: &Mel, units: usize) {
        self.add("audio.mel.window.weight", &[m.window], Kind::Mel);
        self.add("audio.mel.filters.weight", &[m.bands, m.fft / 2 + 1], Kind::Mel);
        self.add("audio.mel.mean", &[m.bands_width()], Kind::Mel);
        self.add("audio.mel.scale", &[m.bands_width()], Kind::Mel);
        for (i, (outputs, inputs)) in m.network.iter().flat_map(|n| n.layers(m.bands_width())).enumerate() {
            self.listener(&format!("audio.mel.network.{i}"), &[outputs, inputs]);
        }
        if let Some((blocks, width)) = m.network.as_ref().and_then(|n| Some((n.blocks?, n.width()))) {
            for i in 0..blocks.count {
                self.listener(&format!("audio.mel.network.blocks.{i}.0"), &[width, width, blocks.kernel]);
                self.listener(&format!("audio.mel.network.blocks.{i}.1"), &[width, width, 1]);
            }
        }
        self.add("audio.kmeans.centroids", &[units, m.width()], Kind::Centroids);
    }

    fn mouth(&mut self, m: &Mouth) {
        self.add("mouth.window.weight", &[m.window], Kind::Mel);
        self.add("mouth.filters.weight", &[m.bands, m.fft / 2 + 1], Kind::Mel);
        self.add("mouth.mean", &[m.features()], Kind::Mel);
        self.add("mouth.scale", &[m.features()], Kind::Mel);
        self.add("mouth.rest", &[m.channels.len()], Kind::Bias);
        self.listener("mouth.input", &[m.width, m.features(), m.taps]);
        for i in 0..m.dilations.len() {
            self.listener(&format!("mouth.blocks.{i}.0"), &[m.width, m.width, m.kernel]);
            self.listener(&format!("mouth.blocks.{i}.1"), &[m.width, m.width, 1]);
        }
        self.listener("mouth.head", &[m.outputs(), m.width, 1]);
        if m.behind > 0 {
            self.listener("mouth.later", &[m.outputs(), m.width, 1]);
        }
    }

    fn listener(&mut self, name: &str, shape: &[usize]) {
        self.add(format!("{name}.weight"), shape, Kind::Listener);
        self.add(format!("{name}.bias"), &shape[..1], Kind::Bias);
    }

    fn lm(&mut self, config: &Config) {
        let (lm, vocab) = (&config.lm, config.vocab.size);
        self.add("lm.shared.weight", &[vocab, lm.d_model], Kind::Table);
        self.stack(config, "encoder", lm.num_layers);
        self.stack(config, "decoder", lm.num_decoder_layers);
        if config.is_frames() {
            self.add("lm.frames.type.weight", &[2, lm.d_model], Kind::Table);
            for part in config.part_list() {
                let name = format!("lm.frames.embed.{}.weight", part.name);
                self.add(name, &[part.levels * part.codes, lm.d_model], Kind::Table);
            }
        } else if !lm.tie_word_embeddings {
            self.add("lm.lm_head.weight", &[vocab, lm.d_model], Kind::Product);
        }
    }

    fn stack(&mut self, config: &Config, stack: &str, layers: usize) {
        let lm = &config.lm;
        let (d, inner) = (lm.d_model, lm.num_heads * lm.d_kv);
        let attentions: &[&str] =
            if stack == "encoder" { &["SelfAttention"] } else { &["SelfAttention", "EncDecAttention"] };
        for i in 0..layers {
            let block = format!("lm.{stack}.block.{i}.layer");
            for (j, attention) in attentions.iter().enumerate() {
                for which in ["q", "k", "v"] {
                    self.add(format!("{block}.{j}.{attention}.{which}.weight"), &[inner, d], Kind::Product);
                }
                self.add(format!("{block}.{j}.{attention}.o.weight"), &[d, inner], Kind::Product);
                if (i, j) == (0, 0) {
                    let name = format!("{block}.0.SelfAttention.relative_attention_bias.weight");
                    self.add(name, &[lm.relative_attention_num_buckets, lm.num_heads], Kind::PositionBias);
                }
                self.add(format!("{block}.{j}.layer_norm.weight"), &[d], Kind::Norm);
            }
            let j = attentions.len();
            self.add(format!("{block}.{j}.moe.router.weight"), &[lm.experts, d], Kind::Router);
            for e in 0..lm.experts {
                for (which, shape) in [("wi_0", [lm.d_ff, d]), ("wi_1", [lm.d_ff, d]), ("wo", [d, lm.d_ff])] {
                    self.add(format!("{block}.{j}.moe.experts.{e}.{which}.weight"), &shape, Kind::Product);
                }
            }
            self.add(format!("{block}.{j}.layer_norm.weight"), &[d], Kind::Norm);
        }
        self.add(format!("lm.{stack}.final_layer_norm.weight"), &[d], Kind::Norm);
    }

    fn depth(&mut self, config: &Config) {
        let Some(depth) = &config.depth else { return };
        let d = depth.d_model;
        self.add("depth.input.weight", &[d, config.lm.d_model], Kind::Product);
        if depth.heard.is_some() {
            self.add("depth.heard.weight", &[d, config.lm.d_model], Kind::Product);
        }
        self.add("depth.position.weight", &[config.codes_per_keyframe(), d], Kind::Table);
        for i in 0..depth.num_layers {
            let layer = format!("depth.layers.{i}");
            self.add(format!("{layer}.attention_norm.weight"), &[d], Kind::Norm);
            for which in ["q", "k", "v", "o"] {
                self.add(format!("{layer}.attention.{which}.weight"), &[d, d], Kind::Product);
            }
            self.add(format!("{layer}.feed_forward_norm.weight"), &[d], Kind::Norm);
            for (which, shape) in [("wi_0", [depth.d_ff, d]), ("wi_1", [depth.d_ff, d]), ("wo", [d, depth.d_ff])] {
                self.add(format!("{layer}.feed_forward.{which}.weight"), &shape, Kind::Product);
            }
        }
        self.add("depth.norm.weight", &[d], Kind::Norm);
        for part in config.part_list() {
            let rows = part.levels * part.codes;
            self.add(format!("depth.embed.{}.weight", part.name), &[rows, d], Kind::Table);
            self.add(format!("depth.head.{}.weight", part.name), &[rows, d], Kind::Product);
            if depth.before {
                self.add(format!("depth.before.{}.weight", part.name), &[rows, d], Kind::Table);
            }
        }
    }

    fn vector_interp(&mut self, config: &Config) {
        let d = config.interp.d_model;
        let parts: Vec<_> = config.part_list().into_iter().filter(|part| !part.is_annotation()).collect();
        for part in &parts {
            self.linear(&format!("interp.input.{}", part.name), d, part.width);
        }
        self.add("interp.mask.weight", &[parts.len(), d], Kind::Table);
        self.interp_layers(config);
        for part in &parts {
            self.linear(&format!("interp.head.{}", part.name), part.width, d);
        }
    }

    fn interp(&mut self, config: &Config) {
        let (d, codes) = (config.interp.d_model, config.part_codes());
        for part in Part::ALL {
            self.add(format!("interp.embed.{}.weight", part.name()), &[codes + 1, d], Kind::Table);
        }
        self.interp_layers(config);
        for part in Part::ALL {
            self.linear(&format!("interp.head.{}", part.name()), codes, d);
        }
    }

    /// Layers between inputs and heads, which both interpolation networks have.
    fn interp_layers(&mut self, config: &Config) {
        let c = &config.interp;
        let d = c.d_model;
        self.add("interp.frame_type.weight", &[3, d], Kind::Table);
        self.add("interp.position.weight", &[c.max_frames, d], Kind::Table);
        for (stack, layers) in [("temporal", c.temporal_layers), ("part", c.part_layers)] {
            for i in 0..layers {
                let layer = format!("interp.{stack}.{i}");
                self.add(format!("{layer}.self_attn.in_proj_weight"), &[3 * d, d], Kind::Product);
                self.add(format!("{layer}.self_attn.in_proj_bias"), &[3 * d], Kind::Bias);
                self.linear(&format!("{layer}.self_attn.out_proj"), d, d);
                self.linear(&format!("{layer}.linear1"), c.d_ff, d);
                self.linear(&format!("{layer}.linear2"), d, c.d_ff);
                self.norm(&format!("{layer}.norm1"), d);
                self.norm(&format!("{layer}.norm2"), d);
            }
        }
        self.norm("interp.norm", d);
    }

    fn vq(&mut self, config: &Config, encoders: bool) {
        let vq = &config.vq;
        for part in config.part_list() {
            let Some(channels) = part.channels(&config.face) else { continue };
            let (name, count) = (format!("vq.{}", part.name), channels.count());
            let rows = part.levels * part.codes;
            self.add(format!("{name}.quantizer.embedding.weight"), &[rows, part.width], Kind::Centroids);
            if encoders {
                self.encoder(&name, count, part.width, part.layers);
            }
            self.decoder(&name, count, part.width, part.layers);
        }
        self.encoder("vq.root", vq.root.channels, vq.width, vq.root.layers);
        self.decoder("vq.root", vq.root.channels, vq.width, vq.root.layers);
    }

    fn residual(&mut self, name: &str, width: usize) {
        self.conv(&format!("{name}.model.0"), width, width, 3);
        self.conv(&format!("{name}.model.2"), width, width, 3);
    }

    fn encoder(&mut self, name: &str, channels: usize, width: usize, layers: usize) {
        for i in 0..layers {
            let input = if i == 0 { channels } else { width };
            self.conv(&format!("{name}.encoder.main.{}", 3 * i), width, input, 3);
            self.residual(&format!("{name}.encoder.main.{}", 3 * i + 2), width);
        }
    }

    fn decoder(&mut self, name: &str, channels: usize, width: usize, layers: usize) {
        self.residual(&format!("{name}.decoder.main.0"), width);
        self.residual(&format!("{name}.decoder.main.1"), width);
        for i in 0..layers {
            let output = if i + 1 == layers { channels } else { width };
            self.conv(&format!("{name}.decoder.main.{}", 2 + 2 * i), output, width, 3);
        }
        self.conv(&format!("{name}.decoder.main.{}", 2 + 2 * layers), channels, channels, 3);
    }
}
