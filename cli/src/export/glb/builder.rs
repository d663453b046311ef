//! The binary buffer and the glTF objects that refer into it.

use super::Surface;
use gltf_json as json;
use json::accessor::{ComponentType, GenericComponentType, Type};
use json::mesh::{Mesh, MorphTarget, Primitive, Semantic};
use json::validation::{Checked::Valid, USize64};
use json::{Accessor, Index, Node, buffer, material};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// An index into one of the root's lists.
pub(super) fn index<T>(at: usize) -> Index<T> {
    Index::new(u32::try_from(at).expect("a file has far fewer objects than 2^32"))
}

/// The attributes and indices of a surface.
pub(super) struct Attributes {
    pub(super) attributes: BTreeMap<json::validation::Checked<Semantic>, Index<Accessor>>,
    pub(super) indices: Index<Accessor>,
}

/// A glTF file in the making.
#[derive(Default)]
pub(super) struct Builder {
    pub(super) root: json::Root,
    bin: Vec<u8>,
}

/// What an accessor says beside where its data is.
struct Layout {
    component: ComponentType,
    kind: Type,
    count: usize,
    target: Option<buffer::Target>,
}

impl Builder {
    pub(super) fn material(&mut self, name: &str, [r, g, b]: [f32; 3]) -> Index<material::Material> {
        self.root.push(material::Material {
            name: Some(name.to_owned()),
            double_sided: true,
            pbr_metallic_roughness: material::PbrMetallicRoughness {
                base_color_factor: material::PbrBaseColorFactor([r, g, b, 1.0]),
                metallic_factor: material::StrengthFactor(0.0),
                roughness_factor: material::StrengthFactor(0.7),
                ..Default::default()
            },
            ..Default::default()
        })
    }

    /// A mesh; its shapes' names go where programs look for them.
    pub(super) fn mesh(&mut self, name: &str, primitive: Primitive, shapes: &[String]) -> Index<Mesh> {
        let extras = (!shapes.is_empty()).then(|| {
            let names = serde_json::json!({ "targetNames": shapes });
            serde_json::value::to_raw_value(&names).expect("a list of strings is valid JSON")
        });
        self.root.push(Mesh {
            name: Some(name.to_owned()),
            primitives: vec![primitive],
            weights: (!shapes.is_empty()).then(|| vec![0.0; shapes.len()]),
            extensions: None,
            extras,
        })
    }

    pub(super) fn skinned(&mut self, name: &str, mesh: Index<Mesh>, skin: Index<json::Skin>) -> Index<Node> {
        self.root.push(Node { name: Some(name.to_owned()), mesh: Some(mesh), skin: Some(skin), ..Node::default() })
    }

    pub(super) fn scene(&mut self, nodes: Vec<Index<Node>>) {
        let scene = self.root.push(json::Scene { nodes, name: None, extensions: None, extras: None });
        self.root.scene = Some(scene);
    }

    pub(super) fn surface(&mut self, surface: &Surface) -> Attributes {
        let target = Some(buffer::Target::ArrayBuffer);
        let positions = self.positions(&surface.positions);
        let normals = self.floats(&surface.normals, Type::Vec3, target);
        let weights = self.floats(&surface.weights, Type::Vec4, target);
        let layout = |component, kind, count, target| Layout { component, kind, count, target: Some(target) };
        let count = surface.joints.len();
        let vertices = buffer::Target::ArrayBuffer;
        let joints = layout(ComponentType::U8, Type::Vec4, count, vertices);
        let joints = self.accessor(surface.joints.as_flattened(), joints);
        let count = surface.indices.len();
        let elements = buffer::Target::ElementArrayBuffer;
        let indices = layout(ComponentType::U16, Type::Scalar, count, elements);
        let bytes: Vec<u8> = surface.indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = self.accessor(&bytes, indices);
        let attributes = BTreeMap::from([
            (Valid(Semantic::Positions), positions),
            (Valid(Semantic::Normals), normals),
            (Valid(Semantic::Joints(0)), joints),
            (Valid(Semantic::Weights(0)), weights),
        ]);
        Attributes { attributes, indices }
    }

    pub(super) fn morph_target(&mut self, moved: &[[f32; 3]]) -> MorphTarget {
        MorphTarget { positions: Some(self.positions(moved)), normals: None, tangents: None }
    }

    pub(super) fn matrices(&mut self, columns: &[[f32; 4]]) -> Index<Accessor> {
        let at = self.floats(columns, Type::Mat4, None);
        self.root.accessors[at.value()].count = USize64::from(columns.len() / 4);
        at
    }

    /// An animation's times, which must have bounds.
    pub(super) fn times(&mut self, seconds: &[f32]) -> Index<Accessor> {
        let at = self.scalars(seconds.iter().copied());
        let rows: Vec<[f32; 1]> = seconds.iter().map(|&x| [x]).collect();
        self.bound(at, &rows);
        at
    }

    pub(super) fn scalars(&mut self, values: impl Iterator<Item = f32>) -> Index<Accessor> {
        let rows: Vec<[f32; 1]> = values.map(|x| [x]).collect();
        self.floats(&rows, Type::Scalar, None)
    }

    /// An animation's values of three or four numbers.
    pub(super) fn vectors<const N: usize>(&mut self, rows: &[[f32; N]]) -> Index<Accessor> {
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
        let values = rows.as_flattened().iter();
        let bytes: Vec<u8> = values.flat_map(|x| x.to_le_bytes()).collect();
        let layout = Layout { component: ComponentType::F32, kind, count: rows.len(), target };
        self.accessor(&bytes, layout)
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

    /// Appends data, aligned as every component type needs, with a view and an accessor of its own.
    fn accessor(&mut self, bytes: &[u8], layout: Layout) -> Index<Accessor> {
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let view = self.root.push(buffer::View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset: Some(USize64::from(offset)),
            byte_stride: None,
            target: layout.target.map(Valid),
            name: None,
            extensions: None,
            extras: None,
        });
        self.root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(layout.count),
            component_type: Valid(GenericComponentType(layout.component)),
            type_: Valid(layout.kind),
            min: None,
            max: None,
            normalized: false,
            sparse: None,
            name: None,
            extensions: None,
            extras: None,
        })
    }

    /// Writes header, JSON and binary chunk.
    pub(super) fn write<W: Write>(mut self, mut out: W) -> io::Result<()> {
        self.root.asset.generator = Some(concat!("umo ", env!("CARGO_PKG_VERSION")).to_owned());
        self.root.push(buffer::Buffer {
            byte_length: USize64::from(self.bin.len()),
            name: None,
            uri: None,
            extensions: None,
            extras: None,
        });
        let mut text = serde_json::to_vec(&self.root)?;
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

fn length(bytes: usize) -> io::Result<[u8; 4]> {
    u32::try_from(bytes).map(u32::to_le_bytes).map_err(|_| {
        let what = "the animation is longer than a glb file can be, 4 GiB";
        io::Error::new(io::ErrorKind::FileTooLarge, what)
    })
}
