// The package's interface.

export { Avatar } from "./avatar.js";
export { Follower } from "./follower.js";
export { Attention, Idle, Model, Mood, Parameter, Pose, Session, UmoError } from "./engine.js";
