// SPDX-License-Identifier: MIT OR Apache-2.0

#include "UmoVoiceComponent.h"

#include "HAL/PlatformTime.h"
#include "Misc/ScopeLock.h"
#include "Misc/ScopeTryLock.h"

#include "Core/Avatar.h"

UUmoVoiceComponent::UUmoVoiceComponent(const FObjectInitializer& ObjectInitializer)
	: Super(ObjectInitializer)
{
	NumChannels = 1;
	// UUmoComponent starts it once there is an avatar to speak for.
	bAutoActivate = false;
}

void UUmoVoiceComponent::SpeakFor(std::shared_ptr<umo_unreal::Avatar> InAvatar, std::shared_ptr<umo_unreal::Ring> InSpeech)
{
	FScopeLock Guard(&Lock);
	Avatar = MoveTemp(InAvatar);
	Speech = MoveTemp(InSpeech);
}

bool UUmoVoiceComponent::Init(int32& SampleRate)
{
	SampleRate = SpeechRate;
	return true;
}

int32 UUmoVoiceComponent::OnGenerateAudio(float* OutAudio, int32 NumSamples)
{
	FMemory::Memzero(OutAudio, sizeof(float) * static_cast<SIZE_T>(NumSamples));
	FScopeTryLock Guard(&Lock);
	if (Guard.IsLocked() && Avatar)
	{
		// Silence if nothing was pushed: the avatar keeps listening.
		const auto Count = static_cast<std::size_t>(NumSamples);
		Speech->read(OutAudio, Count);
		Avatar->hear(OutAudio, Count, 1, static_cast<uint32>(SpeechRate), FPlatformTime::Seconds());
	}
	return NumSamples;
}
