//! The node of a scene: its members, their places and targets.

use std::collections::HashMap;

use godot::classes::{INode3D, Node, Node3D};
use godot::prelude::*;

use crate::avatar::UmoAvatar3D;
use crate::ffi;
use crate::umo::{Scene, Standing, Target};

/// Height of a person's eyes, and of an avatar's without a skeleton.
const EYE_HEIGHT: f32 = 1.6;
const ALL_PARTS: u32 = 31;
const _: () =
    assert!(ffi::SCENE_LOOK | ffi::SCENE_NOD | ffi::SCENE_SMILE | ffi::SCENE_MIRROR | ffi::SCENE_YIELD == ALL_PARTS);

/// A member that the node knows of.
struct Known {
    /// Its number in the scene; 0 while it is not there.
    id: u32,
    /// Number of its session; none for a person.
    session: Option<usize>,
    /// Its target.
    target: Option<InstanceId>,
    parts: u32,
    /// Target and parts that the scene has; unknown after a state was restored.
    sent: Option<(Target, u32)>,
}

impl Known {
    const fn new() -> Self {
        Self { id: 0, session: None, target: None, parts: ALL_PARTS, sent: None }
    }
}

/// Avatars that know each other: who speaks has the floor, the others look there, nod and make room.
///
/// Its members are the UmoAvatar3D nodes among its children, or those that `members` names. It works once per frame before
/// they do.
#[derive(GodotClass)]
#[class(init, base = Node3D)]
pub(crate) struct UmoScene3D {
    /// The members: UmoAvatar3D nodes, and persons, which are any other nodes at the place of the eyes, such as a
    /// Camera3D. Empty: the avatars among the node's children.
    #[export]
    members: Array<NodePath>,
    /// The random choices of the scene follow from it. Applied when the first avatar is open.
    #[export]
    seed: i64,

    scene: Option<Scene>,
    known: HashMap<InstanceId, Known>,
    floor: Option<InstanceId>,
    base: Base<Node3D>,
}

#[godot_api]
impl INode3D for UmoScene3D {
    fn ready(&mut self) {
        if self.base().get_process_priority() == 0 {
            self.base_mut().set_process_priority(-1);
        }
    }

    fn process(&mut self, delta: f64) {
        self.advance(delta);
    }

    fn exit_tree(&mut self) {
        self.close();
    }
}

#[godot_api]
impl UmoScene3D {
    /// Another member has the floor, or nobody (null).
    #[signal]
    fn floor_changed(member: Gd<Node3D>);

    /// An error occurred; the same message is in Godot's log.
    #[signal]
    fn failed(message: GString);

    /// At whom the member looks, and away.
    #[constant]
    const LOOK: i32 = ffi::SCENE_LOOK.cast_signed();
    /// Nods and raised brows while it listens.
    #[constant]
    const NOD: i32 = ffi::SCENE_NOD.cast_signed();
    /// Half smiles while it listens.
    #[constant]
    const SMILE: i32 = ffi::SCENE_SMILE.cast_signed();
    /// Lean and shifts of weight.
    #[constant]
    const MIRROR: i32 = ffi::SCENE_MIRROR.cast_signed();
    /// Giving way to who interrupts it.
    #[constant]
    const YIELD: i32 = ffi::SCENE_YIELD.cast_signed();

    /// Advances the scene. Called by each frame; call it yourself, before the avatars show their poses, if you have called
    /// `set_process(false)`.
    #[func]
    fn advance(&mut self, seconds: f64) {
        if let Err(error) = self.step(seconds) {
            self.complain(&error);
            self.close();
        }
    }

    /// The member that has the floor; null for nobody.
    #[func]
    fn floor(&self) -> Option<Gd<Node3D>> {
        self.floor.and_then(|id| Gd::try_from_instance_id(id).ok())
    }

    /// Makes a member look at another member or at any node, whatever is said; null ends it. The avatar's own
    /// `gaze_target` comes first.
    #[func]
    fn set_target(&mut self, member: Gd<Node3D>, target: Option<Gd<Node3D>>) {
        let target = target.filter(|target| *target != member).map(|target| target.instance_id());
        self.known.entry(member.instance_id()).or_insert_with(Known::new).target = target;
    }

    /// Sets the parts that the scene plays of a member: a sum of `LOOK`, `NOD`, `SMILE`, `MIRROR` and `YIELD`.
    #[func]
    fn set_allowed(&mut self, member: Gd<Node3D>, parts: i32) {
        self.known.entry(member.instance_id()).or_insert_with(Known::new).parts = parts.cast_unsigned() & ALL_PARTS;
    }

    /// Feeds a person's voice, as from a microphone: samples of any rate, full scale 1, of which only the loudness is used.
    /// Returns false if the person is not in the scene.
    #[func]
    fn push_audio(&self, person: Gd<Node3D>, samples: PackedFloat32Array) -> bool {
        let Some((scene, id)) = self.find(&person) else { return false };
        scene.push(id, samples.as_slice()).is_ok()
    }

    /// State of a member: `role` (0 idle, 1 listening, 2 speaking), `attends_to` (a node, or null), `is_contact`,
    /// `nods`, `brows`, `smiles`, `yielding`, `level`. Empty if it is not in the scene.
    #[func]
    fn get_member(&self, member: Gd<Node3D>) -> VarDictionary {
        let Some(info) = self.find(&member).and_then(|(scene, id)| scene.member(id).ok()) else {
            return VarDictionary::new();
        };
        let other = self.node_of(info.attends_to).and_then(|id| Gd::<Node3D>::try_from_instance_id(id).ok());
        vdict! {
            "role" => info.role,
            "attends_to" => &other.to_variant(),
            "is_contact" => info.is_contact == 1,
            "nods" => info.nods,
            "brows" => info.brows,
            "smiles" => info.smiles,
            "yielding" => info.yielding,
            "level" => info.level,
        }
    }

    /// Returns the complete state of the scene and of its avatars' streams, for `restore_state`; empty while a chunk of one
    /// is being computed: try again in the next frame.
    #[func]
    fn save_state(&self) -> PackedByteArray {
        self.tell(Scene::save).unwrap_or_default()
    }

    /// Continues from a saved state of this scene, or of one with the same members in the same order, whose avatars have
    /// the same properties: the same calls then give bit-identical motion. Targets and parts stay those of the node.
    #[func]
    fn restore_state(&mut self, state: PackedByteArray) -> bool {
        if self.tell(|scene| scene.restore(state.as_slice())).is_none() {
            return false;
        }
        for (node, known) in &mut self.known {
            known.sent = None;
            if known.session.is_some()
                && let Ok(mut avatar) = Gd::<UmoAvatar3D>::try_from_instance_id(*node)
            {
                avatar.bind_mut().go_on();
            }
        }
        true
    }
}

impl UmoScene3D {
    /// Calls the scene and reports an error; `None` if there is no scene yet or the call fails.
    fn tell<T>(&self, call: impl FnOnce(&Scene) -> Result<T, String>) -> Option<T> {
        call(self.scene.as_ref()?).map_err(|error| self.complain(&error)).ok()
    }

    fn complain(&self, error: &str) {
        godot_error!("umo: {error}");
        self.to_gd().call_deferred("emit_signal", vslice!["failed", error]);
    }

    fn close(&mut self) {
        self.scene = None;
        self.floor = None;
        for known in self.known.values_mut() {
            (known.id, known.session) = (0, None);
        }
    }

    fn find(&self, member: &Gd<Node3D>) -> Option<(&Scene, u32)> {
        let known = self.known.get(&member.instance_id()).filter(|known| known.id != 0)?;
        Some((self.scene.as_ref()?, known.id))
    }

    fn node_of(&self, id: u32) -> Option<InstanceId> {
        self.known.iter().find(|(_, known)| id != 0 && known.id == id).map(|(&node, _)| node)
    }

    fn nodes(&self) -> Vec<Gd<Node3D>> {
        let cast = |node: Gd<Node>| node.try_cast::<Node3D>().ok();
        if self.members.is_empty() {
            let children = self.base().get_children();
            let avatars = children.iter_shared().filter_map(|node| node.try_cast::<UmoAvatar3D>().ok());
            return avatars.map(Gd::upcast).collect();
        }
        self.members.iter_shared().filter_map(|path| self.base().get_node_or_null(&path).and_then(cast)).collect()
    }

    fn step(&mut self, seconds: f64) -> Result<(), String> {
        let nodes = self.nodes();
        if self.scene.is_none() {
            self.scene = make(&nodes, self.seed)?;
        }
        let Self { scene: Some(scene), known, .. } = self else { return Ok(()) };
        known.retain(|node, known| {
            let is_member = nodes.iter().any(|other| other.instance_id() == *node);
            if !is_member && known.id != 0 {
                scene.remove(known.id);
                (known.id, known.session) = (0, None);
            }
            is_member || node.lookup_validity()
        });
        for node in &nodes {
            follow(scene, known.entry(node.instance_id()).or_insert_with(Known::new), node)?;
        }
        for node in &nodes {
            tell(scene, known, node.instance_id())?;
        }
        scene.update(seconds)?;
        let id = scene.floor()?;
        let floor = self.node_of(id);
        if floor != self.floor {
            self.floor = floor;
            let member = self.floor();
            self.to_gd().call_deferred("emit_signal", vslice!["floor_changed", member]);
        }
        Ok(())
    }
}

/// Makes the scene once an avatar is open, and with it the library.
fn make(nodes: &[Gd<Node3D>], seed: i64) -> Result<Option<Scene>, String> {
    for node in nodes {
        if let Ok(avatar) = node.clone().try_cast::<UmoAvatar3D>()
            && let Some(session) = avatar.bind().session()
        {
            return Scene::new(session, seed.cast_unsigned()).map(Some);
        }
    }
    Ok(None)
}

/// Adds, moves or removes a member. An avatar that is opened again has another session.
fn follow(scene: &Scene, known: &mut Known, node: &Gd<Node3D>) -> Result<(), String> {
    let avatar = node.clone().try_cast::<UmoAvatar3D>().ok();
    let avatar = avatar.as_ref().map(Gd::bind);
    let session = avatar.as_ref().and_then(|avatar| avatar.session());
    let is_there = node.is_inside_tree() && avatar.is_some() == session.is_some();
    let number = session.map(crate::umo::Session::id);
    if known.id != 0 && (!is_there || known.session != number) {
        scene.remove(known.id);
        (known.id, known.session) = (0, None);
    }
    if !is_there {
        return Ok(());
    }
    let standing = avatar.as_ref().map_or_else(|| person(node), |avatar| body(avatar));
    if known.id != 0 {
        return scene.set_place(known.id, &standing);
    }
    known.id = scene.add(session, &standing)?;
    (known.session, known.sent) = (number, Some((Target::Free, ALL_PARTS)));
    Ok(())
}

/// An avatar stands at its skeleton's origin and faces +Z.
fn body(avatar: &UmoAvatar3D) -> Standing {
    let space = avatar.space();
    let eyes = avatar.eyes().map_or(EYE_HEIGHT, |eyes| (space * eyes).y - space.origin.y);
    standing(space.origin, space.basis.col_c(), eyes)
}

/// A person looks along -Z, as a camera does, from the node's position.
fn person(node: &Gd<Node3D>) -> Standing {
    let space = node.get_global_transform();
    standing(space.origin - Vector3::new(0.0, EYE_HEIGHT, 0.0), -space.basis.col_c(), EYE_HEIGHT)
}

fn standing(origin: Vector3, ahead: Vector3, eye_height: f32) -> Standing {
    Standing { position: origin.to_array(), facing: ahead.x.atan2(ahead.z), eye_height: eye_height.max(0.0) }
}

/// Sends changes of a member's target and parts.
fn tell(scene: &Scene, known: &mut HashMap<InstanceId, Known>, node: InstanceId) -> Result<(), String> {
    let Some(member) = known.get(&node).filter(|known| known.id != 0) else { return Ok(()) };
    let looked_at = member.target.and_then(|target| known.get(&target)).map_or(0, |other| other.id);
    let target = match member.target.and_then(|target| Gd::<Node3D>::try_from_instance_id(target).ok()) {
        Some(_) if looked_at != 0 => Target::Member(looked_at),
        Some(target) if target.is_inside_tree() => Target::Point(target.get_global_position().to_array()),
        _ => Target::Free,
    };
    let (id, sent, wanted) = (member.id, member.sent, (target, member.parts));
    if sent.is_none_or(|sent| sent.0 != wanted.0) {
        scene.set_target(id, wanted.0)?;
    }
    if sent.is_none_or(|sent| sent.1 != wanted.1) {
        scene.set_allowed(id, wanted.1)?;
    }
    if let Some(member) = known.get_mut(&node) {
        member.sent = Some(wanted);
    }
    Ok(())
}
