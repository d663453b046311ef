// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <memory>

#include "CoreMinimal.h"
#include "Components/ActorComponent.h"
#include "Engine/EngineTypes.h"

#include "UmoComponent.generated.h"

class FUmoLiveLinkSource;
class FUmoSubmixListener;
class USoundSubmix;
class UUmoVoiceComponent;

namespace umo_unreal
{
class Avatar;
class Ring;
struct SourceSkeleton;
}

/** What the avatar does while no audio comes: the library's UMO_IDLE_ numbers. */
UENUM(BlueprintType)
enum class EUmoIdle : uint8
{
	/** It holds its pose. */
	Hold = 0,
	/** It eases to the pose of rest. */
	Rest = 1,
	/** It moves as it does when it listens. */
	Live = 2,
};

/** Parts whose movement can be scaled. */
UENUM(BlueprintType)
enum class EUmoPart : uint8
{
	Face,
	Hands,
	Upper,
	Lower,
};

/** A pose on its way to the animation threads. */
struct FUmoFrame
{
	/** 55 quaternions x y z w, relative to parents. */
	TArray<float> Rotations;
	/** Centimetres. */
	FVector3f Translation = FVector3f::ZeroVector;
	/** One value per name. */
	TArray<float> Curves;
	TArray<FName> CurveNames;
	/** Null before the first pose. */
	std::shared_ptr<const umo_unreal::SourceSkeleton> Skeleton;
};

DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FUmoFailed, const FString&, Reason);

/**
 * A character that speaks. Its speech is what plays through a submix, or what PushAudio is given where the actor has a Umo
 * Voice. The pose is taken by the animation node "Umo Pose" and, where a subject is named, by Live Link.
 */
UCLASS(ClassGroup = (Umo), meta = (BlueprintSpawnableComponent))
class UMO_API UUmoComponent : public UActorComponent
{
	GENERATED_BODY()

public:
	UUmoComponent();

	/** The submix that the character's speech, and nothing else, plays through. Not needed with a Umo Voice. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	TObjectPtr<USoundSubmix> Submix;

	/** Model file, relative to Content; empty for the one of the plugin. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (FilePathFilter = "safetensors"))
	FFilePath Model;

	/** Keyframes per chunk: fewer answer sooner at more work per frame. 0 is the model's default. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "0"))
	int32 Target = 0;

	/** Frames held back for smoother seams, that much later; -1 is the model's default. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "-1"))
	int32 Lookahead = -1;

	/** While no audio comes. A silent submix is audio. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	EUmoIdle Idle = EUmoIdle::Live;

	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Gains", meta = (ClampMin = "0", ClampMax = "2"))
	float FaceGain = 1.0f;

	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Gains", meta = (ClampMin = "0", ClampMax = "2"))
	float HandsGain = 1.0f;

	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Gains", meta = (ClampMin = "0", ClampMax = "2"))
	float UpperGain = 1.0f;

	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Gains", meta = (ClampMin = "0", ClampMax = "2"))
	float LowerGain = 1.0f;

	/** What the avatar is told: a mood, a style. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	FString Prompt;

	/** The same seed and speech give the same motion. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	int64 Seed = 0;

	/** Speech is heard when its motion is there. Off, motion comes after the sound by GetDelay. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing")
	bool bDelaySpeech = true;

	/** Seconds for computing, on top of the future speech that frames need. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (ClampMin = "0", ClampMax = "5"))
	float Margin = 0.2f;

	/** Seconds from the mixer to the loudspeaker. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (ClampMin = "0", ClampMax = "1"))
	float OutputLatency = 0.04f;

	/** Name of the Live Link subject, None for none. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	FName LiveLinkSubject;

	/** The model cannot be opened, or the avatar has stopped for good. */
	UPROPERTY(BlueprintAssignable, Category = "Umo")
	FUmoFailed OnFailed;

	/** Somebody interrupts the avatar: what it has not said yet is dropped, and it eases to rest. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	void Interrupt(float EaseSeconds = 0.3f);

	/** From the next chunk on; empty ends it. False where the model takes no texts. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetPrompt(const FString& Text);

	/**
	 * Speech for the Umo Voice: mono, full scale 1, at its rate; any amount at a time, on the game thread. Returns how many
	 * samples there was room for, thirty seconds' worth in all.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	int32 PushAudio(const TArray<float>& Samples);

	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetGain(EUmoPart Part, float Gain);

	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetIdle(EUmoIdle NewIdle);

	/** Seconds from speech that comes in to its motion, and where bDelaySpeech is on to its sound. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	float GetDelay() const;

	/** Why the last call that returned false did. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	FString GetLastError() const;

	/** The pose of this tick. The game thread. */
	const FUmoFrame& GetFrame() const { return Frame; }

	virtual void BeginPlay() override;
	virtual void EndPlay(const EEndPlayReason::Type EndPlayReason) override;
	virtual void TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction) override;

private:
	void Open(int32 SampleRate);
	void OpenLiveLink();
	void Close();
	void Fail(const FString& Reason);
	bool StartListening();

	std::shared_ptr<umo_unreal::Avatar> Avatar;
	std::shared_ptr<umo_unreal::Ring> Speech;
	TSharedPtr<FUmoSubmixListener, ESPMode::ThreadSafe> Listener;
	TSharedPtr<FUmoLiveLinkSource> LiveLink;
	TWeakObjectPtr<UUmoVoiceComponent> Voice;
	FUmoFrame Frame;
	double LastTick = 0.0;
};
