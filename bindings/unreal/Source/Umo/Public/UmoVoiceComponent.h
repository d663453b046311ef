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
 * Plays the speech that UUmoComponent::PushAudio is given, from where it stands: attach it to the head. It is heard when its
 * motion is there.
 */
UCLASS(ClassGroup = (Umo), meta = (BlueprintSpawnableComponent))
class UMO_API UUmoVoiceComponent : public USynthComponent
{
	GENERATED_BODY()

public:
	UUmoVoiceComponent(const FObjectInitializer& ObjectInitializer);

	/** Samples per second of the speech that is pushed. The mixer resamples what is heard. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "8000", ClampMax = "192000"))
	int32 SpeechRate = 24000;

	/** The game thread, while it is not playing: whom it speaks for. */
	void SpeakFor(std::shared_ptr<umo_unreal::Avatar> InAvatar, std::shared_ptr<umo_unreal::Ring> InSpeech);

protected:
	virtual bool Init(int32& SampleRate) override;
	virtual int32 OnGenerateAudio(float* OutAudio, int32 NumSamples) override;

private:
	/** Changed under the lock alone, which the audio thread only tries. */
	FCriticalSection Lock;
	std::shared_ptr<umo_unreal::Avatar> Avatar;
	std::shared_ptr<umo_unreal::Ring> Speech;
};
