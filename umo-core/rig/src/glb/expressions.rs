//! The expression table of VRM files, 1.0 and 0.x.

use serde::Deserialize;
use serde_json::{Map, Value};

use super::document::Document;

/// An expression and its shapes.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    pub name: String,
    /// Node with the mesh, shape, and the shape's weight when the expression is 1.
    pub shapes: Vec<(usize, usize, f32)>,
}

fn extension<'a>(document: &'a Document, name: &str) -> Option<&'a Value> {
    document.extensions.get(name)
}

/// Returns the file's expressions; invalid ones are left out.
pub fn expressions(document: &Document) -> Vec<Expression> {
    let mut found = match (extension(document, "VRMC_vrm"), extension(document, "VRM")) {
        (Some(vrm), _) => expressions_of_1(vrm),
        (None, Some(vrm)) => expressions_of_0(vrm, document),
        (None, None) => Vec::new(),
    };
    let shapes = |node: usize| document.nodes.get(node).and_then(|node| document.meshes.get(node.mesh?));
    for expression in &mut found {
        let is_there = |&(node, shape, share): &(usize, usize, f32)| {
            shapes(node).is_some_and(|mesh| shape < mesh.shapes()) && share.is_finite()
        };
        expression.shapes.retain(is_there);
    }
    found.retain(|expression| !expression.shapes.is_empty());
    found
}

fn expressions_of_1(vrm: &Value) -> Vec<Expression> {
    #[derive(Deserialize)]
    struct Bind {
        node: usize,
        index: usize,
        weight: f32,
    }
    let lists = ["/expressions/preset", "/expressions/custom"].into_iter();
    let all = lists.filter_map(|list| vrm.pointer(list)?.as_object()).flat_map(Map::iter);
    let expression = |(name, value): (&String, &Value)| {
        let binds = Vec::<Bind>::deserialize(value.get("morphTargetBinds")?).ok()?;
        let shapes = binds.iter().map(|bind| (bind.node, bind.index, bind.weight)).collect();
        Some(Expression { name: name.clone(), shapes })
    };
    all.filter_map(expression).collect()
}

fn expressions_of_0(vrm: &Value, document: &Document) -> Vec<Expression> {
    #[derive(Deserialize)]
    struct Bind {
        mesh: usize,
        index: usize,
        weight: f32,
    }
    #[derive(Default, Deserialize)]
    #[serde(rename_all = "camelCase", default)]
    struct Group {
        name: String,
        preset_name: String,
        binds: Vec<Value>,
    }
    let groups = vrm.pointer("/blendShapeMaster/blendShapeGroups").and_then(Value::as_array);
    let expression = |group: &Value| {
        let group = Group::deserialize(group).ok()?;
        let known = !group.preset_name.is_empty() && group.preset_name != "unknown";
        let binds = group.binds.iter().filter_map(|bind| Bind::deserialize(bind).ok());
        let nodes =
            |mesh: usize| (0..document.nodes.len()).filter(move |&node| document.nodes[node].mesh == Some(mesh));
        let shapes = binds.flat_map(|bind| nodes(bind.mesh).map(move |node| (node, bind.index, bind.weight / 100.0)));
        Some(Expression { name: if known { group.preset_name } else { group.name }, shapes: shapes.collect() })
    };
    groups.into_iter().flatten().filter_map(expression).collect()
}
