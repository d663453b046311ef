"""Avatars of voice agents: the audio of a synthesiser goes in as it comes, poses come out in step with it.

| module | for |
|---|---|
| `umo.agents` | any agent that runs in asyncio: `Avatar`; a language model that moves it: `Tools` |
| `umo.agents.pipecat` | Pipecat: a frame processor (extra `umo-avatar[pipecat]`) |
| `umo.agents.livekit` | LiveKit agents: an audio output, and a video generator for avatar workers (extra `umo-avatar[livekit]`) |
| `umo.agents.openai` | events of OpenAI's Realtime API and of what speaks its protocol |

    async with umo.agents.Avatar(rate=24000) as avatar:
        avatar.push(pcm16)                  # as the synthesiser gives it; never waits
        avatar.end()                        # the speech is over
        async for pose in avatar:
            play(pose.audio)                # the speech, cut at the poses
            show(pose.frame)
"""

from ._avatar import Avatar, Interrupted, Pose
from ._tools import Tools

__all__ = ["Avatar", "Interrupted", "Pose", "Tools"]
