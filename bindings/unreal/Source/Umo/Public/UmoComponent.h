// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <array>
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

/** What the avatar attends to: the library's UMO_ATTENTION_ numbers. */
UENUM(BlueprintType)
enum class EUmoAttention : uint8
{
	/** It speaks while its speech is heard, listens while PushOtherAudio's is, else idles. */
	Auto = 0,
	/** Nothing in particular. */
	Idle = 1,
	/** Who speaks to it. */
	Listening = 2,
	/** An answer: it looks away. */
	Thinking = 3,
	/** What it says. */
	Speaking = 4,
};

/** The mood of face and posture: the library's UMO_MOOD_ numbers. */
UENUM(BlueprintType)
enum class EUmoMood : uint8
{
	Neutral = 0,
	Joy = 1,
	Sad = 2,
	Angry = 3,
	Surprised = 4,
	Disgusted = 5,
	Afraid = 6,
};

/** Layers over the model's motion whose strength can be set: the order of the library's UMO_PARAMETER_LAYER_ numbers. */
UENUM(BlueprintType)
enum class EUmoLayer : uint8
{
	/** Blinks, gaze and lids. */
	Gaze = 0,
	/** Breath, sway, weight shifts and fingers. */
	Idle = 1,
	/** The face's left and right a little apart. */
	Asymmetry = 2,
	/** Nods on accents, and while listening. */
	Nods = 3,
	/** The mood's face and posture. */
	Mood = 4,
	/** Planted feet, steps, and the way back home. */
	Feet = 5,
};

/** A shape of the lips that one sees with a sound: the library's UMO_LIPS_ numbers. */
UENUM(BlueprintType)
enum class EUmoLips : uint8
{
	/** p, b, m */
	Closed = 0,
	/** f, v */
	Teeth = 1,
	/** w, and vowels such as that of "boot" */
	Round = 2,
};

/** Which hand does a gesture: the library's UMO_SIDE_ numbers. */
UENUM(BlueprintType)
enum class EUmoSide : uint8
{
	/** The right hand; for a point to point at, the hand that is nearer to it. */
	Auto = 0,
	Left = 1,
	Right = 2,
	Both = 3,
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

/** A gesture of your own: the animation of any character with a human's bones, out of a .glb or .vrm file. */
USTRUCT(BlueprintType)
struct UMO_API FUmoGestureFile
{
	GENERATED_BODY()

	/** What PlayGesture calls it. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	FString Name;

	/** Relative to Content. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo", meta = (FilePathFilter = "glb"))
	FFilePath File;

	/** Which of the file's animations; empty for the first. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	FString Animation;

	/** Seconds from its start to the stroke; -1 is its middle. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo", meta = (ClampMin = "-1"))
	float Stroke = -1.0f;

	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	bool bHead = true;

	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	bool bTrunk = true;

	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	bool bLeftArm = true;

	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	bool bRightArm = true;

	/** As the library has them. */
	uint32 Parts() const;
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
	int32 Target = 1;

	/** Frames held back for smoother seams, that much later; -1 is the model's default. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "-1"))
	int32 Lookahead = -1;

	/** Low-pass of the body's motion, standard deviation in frames: 0 is the model's own motion, -1 the default. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "-1", ClampMax = "1.5"))
	float Smoothing = -1.0f;

	/** How strongly the prompt steers, for models that can be guided. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "1", ClampMax = "3"))
	float Guidance = 1.0f;

	/** Keyframes of speech that it hears ahead, that much later, for models that were made to. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "0"))
	int32 Horizon = 0;

	/** Gestures of your own, for PlayGesture. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	TArray<FUmoGestureFile> Gestures;

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

	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	EUmoAttention Attention = EUmoAttention::Auto;

	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	EUmoMood Mood = EUmoMood::Neutral;

	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "0", ClampMax = "1"))
	float MoodStrength = 1.0f;

	/** What the avatar is told: a mood, a style. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	FString Prompt;

	/** The same seed and speech give the same motion. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	int64 Seed = 0;

	/** Speech is heard when its motion is there. Off, as for a microphone, it is heard at once. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing")
	bool bDelaySpeech = true;

	/**
	 * Where speech is not delayed, the mouth moves with the sound and the body follows: for models with a mouth network. Off,
	 * mouth and body come after the sound by GetDelay.
	 */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (EditCondition = "!bDelaySpeech"))
	bool bLiveVoice = true;

	/** Seconds for computing, on top of the future speech that frames need. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (ClampMin = "0", ClampMax = "5"))
	float Margin = 0.2f;

	/** Seconds from the mixer to the loudspeaker: more for Bluetooth, some 0.2. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (ClampMin = "0", ClampMax = "1"))
	float OutputLatency = 0.04f;

	/**
	 * MouthClose is given as the model has it. Off, it is 0 and JawOpen less by as much: for MetaHumans, whose Face_AnimBP adds an
	 * animation of its own for MouthClose.
	 */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	bool bMouthClose = true;

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

	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetAttention(EUmoAttention NewAttention);

	/** Changes are blended over a second. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetMood(EUmoMood NewMood, float Strength = 1.0f);

	/** Strength of a layer over the model's motion, 0 to 1. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetLayer(EUmoLayer Layer, float Strength);

	/** Looks at a point of the world, eyes first; a strength of 0 ends it. May be called every tick. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool LookAt(const FVector& WorldPoint, float Strength = 1.0f);

	/**
	 * The lips have a sound's shape while it is heard, where a synthesiser says when that is: Start is a time of GetGivenSeconds,
	 * which to read as the speech begins to play. Exact within a buffer of the audio device. False while 64 wait.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool HintLips(EUmoLips Shape, float Start, float Duration = 0.08f);

	/** Seconds of audio, silence of the submix included, that the avatar was given up to now. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	float GetGivenSeconds() const;

	/** Plays a gesture over what the avatar does, as soon as possible: one of GetGestureNames, as wave, nod or thumbs_up. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PlayGesture(const FString& Gesture, EUmoSide Side = EUmoSide::Auto, float Strength = 1.0f);

	/** The same for gestures that point, at a point of the world. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PlayGestureAt(const FString& Gesture, const FVector& WorldPoint, EUmoSide Side = EUmoSide::Auto, float Strength = 1.0f);

	UFUNCTION(BlueprintPure, Category = "Umo")
	TArray<FString> GetGestureNames() const;

	/**
	 * Audio of who speaks to the avatar, so that it listens: mono, full scale 1, at the rate of its own speech; on the game
	 * thread. Only its loudness counts.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PushOtherAudio(const TArray<float>& Samples);

	/** Whether the mouth moves with the sound: speech is not delayed, and the model has a mouth network. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	bool IsLive() const;

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
	std::array<float, 3> InAvatarSpace(const FVector& WorldPoint) const;

	std::shared_ptr<umo_unreal::Avatar> Avatar;
	std::shared_ptr<umo_unreal::Ring> Speech;
	TSharedPtr<FUmoSubmixListener, ESPMode::ThreadSafe> Listener;
	TSharedPtr<FUmoLiveLinkSource> LiveLink;
	TWeakObjectPtr<UUmoVoiceComponent> Voice;
	FUmoFrame Frame;
	double LastTick = 0.0;
};
