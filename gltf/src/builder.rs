//! The binary buffer and the glTF objects that reference it.

use crate::keys::Keying;
use crate::shapes::Shape;
use gltf_json as json;
use json::accessor::{ComponentType, GenericComponentType, IndexComponentType, Type, sparse};
use json::mesh::{Mesh, MorphTarget, Primitive, Semantic};
use json::validation::{Checked::Valid, USize64};
use json::{Accessor, Index, Node, buffer, image, material, texture};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};
use std::ops::Range;
use umo_core_base::memory::{append, collected};
use umo_figure::Mesh as Figure;
use umo_figure::detail::Detail;
use umo_figure::palette::Palette;

/// An index into one of the root's lists.
pub(crate) fn index<T>(at: usize) -> Index<T> {
    Index::new(u32::try_from(at).expect("a file has far fewer objects than 2^32"))
}

/// The attributes and indices of a surface.
pub(crate) struct Attributes {
    pub(crate) attributes: BTreeMap<json::validation::Checked<Semantic>, Index<Accessor>>,
    pub(crate) indices: Index<Accessor>,
}

/// A glTF file under construction.
#[derive(Default)]
pub(crate) struct Builder {
    pub(crate) root: json::Root,
    bin: Vec<u8>,
}

/// Growing byte buffer. Unwinds to [`umo_core_base::memory::catch`] if memory is exhausted.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl Write for Bytes {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        append(&mut self.0, bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Description of an accessor, apart from the location of its data.
struct Layout {
    component: ComponentType,
    kind: Type,
    count: usize,
    target: Option<buffer::Target>,
    /// Whether integers represent 0 to 1.
    normalized: bool,
}

/// A figure's pictures as PNG files.
#[derive(Debug)]
pub(crate) struct Textures {
    colors: Vec<u8>,
    finishes: Vec<u8>,
    /// Normal map of each relief of the figure; `None` for smooth surfaces.
    normals: Vec<(Detail, Option<Vec<u8>>)>,
}

impl Textures {
    /// # Errors
    /// The palette does not fit a picture.
    pub(crate) fn new(figure: &Figure, palette: &Palette) -> io::Result<Self> {
        let [mut colors, mut finishes] = [Bytes::default(), Bytes::default()];
        palette.write(&mut colors)?;
        palette.write_finishes(&mut finishes)?;
        let details: BTreeSet<Detail> = figure.details.iter().copied().collect();
        let normals = details.into_iter().map(|detail| {
            let map = palette.flattened(figure, detail);
            let png = map.map(|map| {
                let mut png = Bytes::default();
                map.write(&mut png).map(|()| png.0)
            });
            Ok((detail, png.transpose()?))
        });
        Ok(Self { colors: colors.0, finishes: finishes.0, normals: normals.collect::<io::Result<_>>()? })
    }
}

impl Builder {
    /// Adds one material per relief; colours, roughness and metalness come from the palette.
    pub(crate) fn materials(&mut self, textures: &Textures) -> Vec<(Detail, Index<material::Material>)> {
        // The palette's squares must not be blended, so it has no mipmaps.
        let sampler = |min_filter, wrap| texture::Sampler {
            mag_filter: Some(Valid(texture::MagFilter::Linear)),
            min_filter: Some(Valid(min_filter)),
            wrap_s: Valid(wrap),
            wrap_t: Valid(wrap),
            ..texture::Sampler::default()
        };
        let once = self.root.push(sampler(texture::MinFilter::Linear, texture::WrappingMode::ClampToEdge));
        let repeated = sampler(texture::MinFilter::LinearMipmapLinear, texture::WrappingMode::Repeat);
        let repeated = self.root.push(repeated);
        let colors = self.texture("colors", &textures.colors, once);
        let finishes = self.texture("finishes", &textures.finishes, once);
        let info = |index, tex_coord| texture::Info { index, tex_coord, extensions: None, extras: None };
        let mut materials = Vec::with_capacity(textures.normals.len());
        for (detail, normals) in &textures.normals {
            let normals = normals.as_ref().map(|png| self.texture(detail.name(), png, repeated));
            let normals = normals.map(|index| material::NormalTexture {
                index,
                scale: 1.0,
                tex_coord: 1,
                extensions: None,
                extras: None,
            });
            let material = self.root.push(material::Material {
                name: Some(detail.name().to_owned()),
                pbr_metallic_roughness: material::PbrMetallicRoughness {
                    metallic_factor: material::StrengthFactor(1.0),
                    roughness_factor: material::StrengthFactor(1.0),
                    base_color_texture: Some(info(colors, 0)),
                    metallic_roughness_texture: Some(info(finishes, 0)),
                    ..Default::default()
                },
                normal_texture: normals,
                ..Default::default()
            });
            materials.push((*detail, material));
        }
        materials
    }

    fn texture(&mut self, name: &str, png: &[u8], sampler: Index<texture::Sampler>) -> Index<json::Texture> {
        let view = self.view(png, None);
        let source = self.root.push(json::Image {
            buffer_view: Some(view),
            mime_type: Some(image::MimeType("image/png".to_owned())),
            name: Some(name.to_owned()),
            uri: None,
            extensions: None,
            extras: None,
        });
        self.root.push(json::Texture { sampler: Some(sampler), source, name: None, extensions: None, extras: None })
    }

    /// Adds a mesh; its shape names go where readers look for them.
    pub(crate) fn mesh(&mut self, name: &str, primitives: Vec<Primitive>, shapes: &[String]) -> Index<Mesh> {
        let extras = (!shapes.is_empty()).then(|| {
            let names = serde_json::json!({ "targetNames": shapes });
            serde_json::value::to_raw_value(&names).expect("a list of strings is valid JSON")
        });
        self.root.push(Mesh {
            name: Some(name.to_owned()),
            primitives,
            weights: (!shapes.is_empty()).then(|| vec![0.0; shapes.len()]),
            extensions: None,
            extras,
        })
    }

    pub(crate) fn skinned(&mut self, name: &str, mesh: Index<Mesh>, skin: Index<json::Skin>) -> Index<Node> {
        self.root.push(Node { name: Some(name.to_owned()), mesh: Some(mesh), skin: Some(skin), ..Node::default() })
    }

    pub(crate) fn scene(&mut self, nodes: Vec<Index<Node>>) {
        let scene = self.root.push(json::Scene { nodes, name: None, extensions: None, extras: None });
        self.root.scene = Some(scene);
    }

    /// Adds markers to the scene, whose extras Blender keeps as the scene's properties; it drops an animation's.
    pub(crate) fn mark(&mut self, keying: &Keying) {
        let extras = serde_json::value::to_raw_value(&keying.extras()).expect("text and numbers are valid JSON");
        self.root.scenes[0].extras = Some(extras);
    }

    /// Adds a surface: the vertices of `range` with that relief, and the triangles between them.
    pub(crate) fn surface(
        &mut self,
        figure: &Figure,
        palette: &Palette,
        range: Range<usize>,
        detail: Detail,
    ) -> Attributes {
        let target = Some(buffer::Target::ArrayBuffer);
        let vertices: Vec<usize> = range.filter(|&vertex| figure.details[vertex] == detail).collect();
        let positions = self.positions(&picked(&figure.positions, &vertices));
        let normals = self.floats(&picked(&figure.normals, &vertices), Type::Vec3, target);
        let count = vertices.len();
        let layout = |component, kind| Layout { component, kind, count, target, normalized: true };
        let places = self.floats(&picked(&palette.places, &vertices), Type::Vec2, target);
        let weights: Vec<[u16; 4]> = vertices.iter().map(|&vertex| shares(figure.weights[vertex])).collect();
        let weights = self.accessor(&little_endian(&weights), layout(ComponentType::U16, Type::Vec4));
        let joints = Layout { normalized: false, ..layout(ComponentType::U8, Type::Vec4) };
        let joints = self.accessor(picked(&figure.joints, &vertices).as_flattened(), joints);
        let mut attributes = BTreeMap::from([
            (Valid(Semantic::Positions), positions),
            (Valid(Semantic::Normals), normals),
            (Valid(Semantic::TexCoords(0)), places),
            (Valid(Semantic::Joints(0)), joints),
            (Valid(Semantic::Weights(0)), weights),
        ]);
        // Only a normal map needs these attributes.
        if detail != Detail::None {
            let places = self.floats(&picked(&figure.detail_places, &vertices), Type::Vec2, target);
            let tangents = self.floats(&picked(&figure.tangents, &vertices), Type::Vec4, target);
            attributes.insert(Valid(Semantic::TexCoords(1)), places);
            attributes.insert(Valid(Semantic::Tangents), tangents);
        }
        let mut numbers = vec![None; figure.positions.len()];
        for (number, &vertex) in vertices.iter().enumerate() {
            numbers[vertex] = u16::try_from(number).ok();
        }
        let (triangles, _) = figure.indices.as_chunks::<3>();
        // A triangle has a single relief, and its corners are all inside or all outside the range.
        let wanted = vertices.first().zip(vertices.last()).map_or(0..0, |(&first, &last)| first..last + 1);
        let inside = triangles.iter().filter(|corners| {
            let first = corners[0] as usize;
            wanted.contains(&first) && figure.details[first] == detail
        });
        let corners = inside.flatten().map(|&corner| numbers[corner as usize]);
        let corners: Vec<[u16; 1]> = corners.map(|i| [i.expect("the figure has few vertices")]).collect();
        let indices = Layout {
            component: ComponentType::U16,
            kind: Type::Scalar,
            count: corners.len(),
            target: Some(buffer::Target::ElementArrayBuffer),
            normalized: false,
        };
        let indices = self.accessor(&little_endian(&corners), indices);
        Attributes { attributes, indices }
    }

    /// Adds a shape of a surface of `count` vertices; only those that move are stored.
    pub(crate) fn morph_target(&mut self, shape: &Shape, count: usize) -> MorphTarget {
        // A viseme may move nothing, and some readers reject an accessor without data.
        let still = Shape { vertices: vec![0], positions: vec![[0.0; 3]], normals: vec![[0.0; 3]] };
        let shape = if shape.vertices.is_empty() { &still } else { shape };
        let vertices = shape.vertices.iter().map(|&vertex| u16::try_from(vertex).map(|vertex| [vertex]));
        let vertices: Vec<[u16; 1]> = vertices.collect::<Result<_, _>>().expect("the head has few vertices");
        let vertices = self.view(&little_endian(&vertices), None);
        let mut sparse = |rows: &[[f32; 3]]| {
            let bytes: Vec<u8> = rows.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
            let values = self.view(&bytes, None);
            self.root.push(Accessor {
                sparse: Some(sparse::Sparse {
                    count: USize64::from(rows.len()),
                    indices: sparse::Indices {
                        buffer_view: vertices,
                        byte_offset: USize64(0),
                        component_type: Valid(IndexComponentType(ComponentType::U16)),
                        extensions: None,
                        extras: None,
                    },
                    values: sparse::Values {
                        buffer_view: values,
                        byte_offset: USize64(0),
                        extensions: None,
                        extras: None,
                    },
                    extensions: None,
                    extras: None,
                }),
                ..plain(ComponentType::F32, Type::Vec3, count)
            })
        };
        let (positions, normals) = (sparse(&shape.positions), sparse(&shape.normals));
        // All other vertices stay: their values are 0.
        let still = if shape.positions.len() < count { Some([0.0; 3]) } else { None };
        let reached: Vec<[f32; 3]> = shape.positions.iter().copied().chain(still).collect();
        self.bound(positions, &reached);
        MorphTarget { positions: Some(positions), normals: Some(normals), tangents: None }
    }

    pub(crate) fn matrices(&mut self, columns: &[[f32; 4]]) -> Index<Accessor> {
        let at = self.floats(columns, Type::Mat4, None);
        self.root.accessors[at.value()].count = USize64::from(columns.len() / 4);
        at
    }

    /// Adds an animation's times, for which bounds are mandatory.
    pub(crate) fn times(&mut self, seconds: &[f32]) -> Index<Accessor> {
        let at = self.scalars(seconds.iter().copied());
        let rows: Vec<[f32; 1]> = collected(seconds.iter().map(|&x| [x]));
        self.bound(at, &rows);
        at
    }

    pub(crate) fn scalars(&mut self, values: impl ExactSizeIterator<Item = f32>) -> Index<Accessor> {
        let rows: Vec<[f32; 1]> = collected(values.map(|x| [x]));
        self.floats(&rows, Type::Scalar, None)
    }

    /// Adds an animation's values of three or four components.
    pub(crate) fn vectors<const N: usize>(&mut self, rows: &[[f32; N]]) -> Index<Accessor> {
        let kind = const {
            match N {
                3 => Type::Vec3,
                4 => Type::Vec4,
                _ => panic!("a vector has three or four numbers"),
            }
        };
        self.floats(rows, kind, None)
    }

    fn positions(&mut self, rows: &[[f32; 3]]) -> Index<Accessor> {
        let at = self.floats(rows, Type::Vec3, Some(buffer::Target::ArrayBuffer));
        self.bound(at, rows);
        at
    }

    fn floats<const N: usize>(
        &mut self,
        rows: &[[f32; N]],
        kind: Type,
        target: Option<buffer::Target>,
    ) -> Index<Accessor> {
        let bytes = collected(rows.as_flattened().iter().map(|x| x.to_le_bytes()));
        let layout = Layout { component: ComponentType::F32, kind, count: rows.len(), target, normalized: false };
        self.accessor(bytes.as_flattened(), layout)
    }

    fn bound<const N: usize>(&mut self, at: Index<Accessor>, rows: &[[f32; N]]) {
        let fold = |pick: fn(f32, f32) -> f32| -> serde_json::Value {
            let column = |i: usize| rows.iter().map(|row| row[i]).reduce(pick);
            (0..N).filter_map(column).collect::<Vec<f32>>().into()
        };
        let accessor = &mut self.root.accessors[at.value()];
        accessor.min = Some(fold(f32::min));
        accessor.max = Some(fold(f32::max));
    }

    /// Appends data with its own view and accessor.
    fn accessor(&mut self, bytes: &[u8], layout: Layout) -> Index<Accessor> {
        let view = self.view(bytes, layout.target);
        self.root.push(Accessor {
            buffer_view: Some(view),
            normalized: layout.normalized,
            ..plain(layout.component, layout.kind, layout.count)
        })
    }

    /// Appends data, aligned for every component type.
    fn view(&mut self, bytes: &[u8], target: Option<buffer::Target>) -> Index<buffer::View> {
        let offset = self.bin.len();
        append(&mut self.bin, bytes);
        let odd = self.bin.len() % 4;
        append(&mut self.bin, &[0; 4][..(4 - odd) % 4]);
        self.root.push(buffer::View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset: Some(USize64::from(offset)),
            byte_stride: None,
            target: target.map(Valid),
            name: None,
            extensions: None,
            extras: None,
        })
    }

    /// Adds an optional extension of the whole file.
    pub(crate) fn extension(&mut self, name: &str, value: serde_json::Value) {
        self.root.extensions_used.push(name.to_owned());
        self.root.extensions.get_or_insert_default().others.insert(name.to_owned(), value);
    }

    /// Writes header, JSON and binary chunk.
    pub(crate) fn write<W: Write>(mut self, mut out: W) -> io::Result<()> {
        self.root.asset.generator = Some(concat!("umo ", env!("CARGO_PKG_VERSION")).to_owned());
        self.root.push(buffer::Buffer {
            byte_length: USize64::from(self.bin.len()),
            name: None,
            uri: None,
            extensions: None,
            extras: None,
        });
        let mut text = Bytes::default();
        serde_json::to_writer(&mut text, &self.root)?;
        let Bytes(mut text) = text;
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.bin.len();
        out.write_all(b"glTF")?;
        out.write_all(&2_u32.to_le_bytes())?;
        out.write_all(&length(total)?)?;
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bin)] {
            out.write_all(&length(chunk.len())?)?;
            out.write_all(kind)?;
            out.write_all(chunk)?;
        }
        Ok(())
    }
}

/// Selects the rows of some vertices.
fn picked<T: Copy>(rows: &[T], vertices: &[usize]) -> Vec<T> {
    collected(vertices.iter().map(|&vertex| rows[vertex]))
}

fn length(bytes: usize) -> io::Result<[u8; 4]> {
    u32::try_from(bytes).map(u32::to_le_bytes).map_err(|_| {
        let what = "the animation is longer than a glb file can be, 4 GiB";
        io::Error::new(io::ErrorKind::FileTooLarge, what)
    })
}

/// An accessor without data, which means zeros.
fn plain(component: ComponentType, kind: Type, count: usize) -> Accessor {
    Accessor {
        buffer_view: None,
        byte_offset: None,
        count: USize64::from(count),
        component_type: Valid(GenericComponentType(component)),
        type_: Valid(kind),
        min: None,
        max: None,
        normalized: false,
        sparse: None,
        name: None,
        extensions: None,
        extras: None,
    }
}

fn little_endian<const N: usize>(rows: &[[u16; N]]) -> Vec<u8> {
    rows.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Converts weights to integers whose sum is exactly 65,535.
fn shares(weights: [f32; 4]) -> [u16; 4] {
    let mut shares = weights.map(whole);
    // The first is the largest and absorbs the rounding error.
    shares[0] = u16::MAX - shares[1] - shares[2] - shares[3];
    shares
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65,535")]
fn whole(share: f32) -> u16 {
    (share.clamp(0.0, 1.0) * f32::from(u16::MAX)).round() as u16
}
