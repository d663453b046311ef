"""Avatars of voice agents: a synthesiser's audio goes in as it arrives, poses come out in sync with it.

| module | for |
|---|---|
| `umo.agents` | any asyncio agent: `Avatar`; control by a language model: `Tools` |
| `umo.agents.pipecat` | Pipecat: a frame processor (extra `umo-avatar[pipecat]`) |
| `umo.agents.livekit` | LiveKit agents: an audio output, and a video generator for avatar workers (extra `umo-avatar[livekit]`) |
| `umo.agents.openai` | events of OpenAI's Realtime API and compatible servers |

    async with umo.agents.Avatar(rate=24000) as avatar:
        avatar.push(pcm16)                  # from the synthesiser; never waits
        avatar.end()                        # the end of the speech
        async for pose in avatar:
            play(pose.audio)                # the speech, cut at pose boundaries
            show(pose.frame)
"""

from ._avatar import Avatar, Interrupted, Pose
from ._tools import Tools

__all__ = ["Avatar", "Interrupted", "Pose", "Tools"]
