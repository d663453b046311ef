// The package's interface.

export { Avatar } from "./avatar.js";
export { Follower } from "./follower.js";
export { Model, Pose, Scene, Session, UmoError } from "./engine.js";
export { Attention, Idle, Mood, Parameter } from "./generated.js";
