// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <memory>

#include "CoreMinimal.h"
#include "Components/SynthComponent.h"

#include "UmoVoiceComponent.generated.h"

namespace umo_unreal
{
class Avatar;
class Ring;
}

/**
 * Plays the speech given to UUmoComponent::PushAudio from its own location, so attach it to the head. The speech is
 * heard when its motion is ready.
 */
UCLASS(ClassGroup = (Umo), meta = (BlueprintSpawnableComponent))
class UMO_API UUmoVoiceComponent : public USynthComponent
{
	GENERATED_BODY()

public:
	UUmoVoiceComponent(const FObjectInitializer& ObjectInitializer);

	/** Sample rate of the pushed speech. The mixer resamples it for output. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "8000", ClampMax = "192000"))
	int32 SpeechRate = 24000;

	/** Game thread, while it is not playing: sets the avatar that it speaks for. */
	void SpeakFor(std::shared_ptr<umo_unreal::Avatar> InAvatar, std::shared_ptr<umo_unreal::Ring> InSpeech);

protected:
	virtual bool Init(int32& SampleRate) override;
	virtual int32 OnGenerateAudio(float* OutAudio, int32 NumSamples) override;

private:
	/** Changed only under the lock; the audio thread only tries to lock it. */
	FCriticalSection Lock;
	std::shared_ptr<umo_unreal::Avatar> Avatar;
	std::shared_ptr<umo_unreal::Ring> Speech;
};
