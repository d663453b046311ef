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

/** Behaviour while no audio arrives: values of UMO_IDLE_. */
UENUM(BlueprintType)
enum class EUmoIdle : uint8
{
	/** Holds its pose. */
	Hold = 0,
	/** Eases to the rest pose. */
	Rest = 1,
	/** Moves as while listening. */
	Live = 2,
};

/** Focus of the avatar's attention: values of UMO_ATTENTION_. */
UENUM(BlueprintType)
enum class EUmoAttention : uint8
{
	/** Speaking while its speech is heard, listening while PushOtherAudio's is, else idle. */
	Auto = 0,
	/** Nothing in particular. */
	Idle = 1,
	/** The person who speaks to it. */
	Listening = 2,
	/** Thinking about an answer: looks away. */
	Thinking = 3,
	/** Its own speech. */
	Speaking = 4,
};

/** Mood of face and posture: values of UMO_MOOD_. */
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

/** Layers over the model's motion with adjustable strength, in the order of UMO_PARAMETER_LAYER_. */
UENUM(BlueprintType)
enum class EUmoLayer : uint8
{
	/** Blinks, gaze and lids. */
	Gaze = 0,
	/** Breath, sway, weight shifts and fingers; hands at rest. */
	Idle = 1,
	/** Slight differences between the left and right of the face. */
	Asymmetry = 2,
	/** Nods on accents, and while listening. */
	Nods = 3,
	/** Face and posture of the mood. */
	Mood = 4,
	/** Planted feet, steps, and returning to the start position. */
	Feet = 5,
	/** Trunk, shoulders and legs that go with the hands. */
	Body = 6,
};

/** Visible lip shape of a sound: values of UMO_LIPS_. */
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

/** Hand that performs a gesture: values of UMO_SIDE_. */
UENUM(BlueprintType)
enum class EUmoSide : uint8
{
	/** The right hand; for pointing, the hand nearer to the target. */
	Auto = 0,
	Left = 1,
	Right = 2,
	Both = 3,
};

/** Body parts with scalable movement. */
UENUM(BlueprintType)
enum class EUmoPart : uint8
{
	Face,
	Hands,
	Upper,
	Lower,
};

/** A custom gesture: the animation of any humanoid character from a .glb or .vrm file. */
USTRUCT(BlueprintType)
struct UMO_API FUmoGestureFile
{
	GENERATED_BODY()

	/** Name for PlayGesture. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	FString Name;

	/** Path relative to Content. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo", meta = (FilePathFilter = "glb"))
	FFilePath File;

	/** Name of the animation in the file; empty for the first. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	FString Animation;

	/** Seconds from its start to the stroke; -1 for its middle. */
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

	/** As the library's flags. */
	uint32 Parts() const;
};

/** A pose for the animation threads. */
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
 * A speaking character. Its speech is what plays through a submix, or what PushAudio receives if the actor has a Umo
 * Voice. The pose is used by the animation node "Umo Pose" and, if a subject is named, by Live Link.
 */
UCLASS(ClassGroup = (Umo), meta = (BlueprintSpawnableComponent))
class UMO_API UUmoComponent : public UActorComponent
{
	GENERATED_BODY()

public:
	UUmoComponent();

	/** Submix that carries this character's speech and nothing else. Not needed with a Umo Voice. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	TObjectPtr<USoundSubmix> Submix;

	/** Model file, relative to Content; empty for the plugin's model. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (FilePathFilter = "safetensors"))
	FFilePath Model;

	/** Keyframes per chunk: fewer reduce latency and cost more work per frame. 0 for the model's default. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "0"))
	int32 Target = 1;

	/** Frames held back for smoother seams; adds that much latency. -1 for the model's default. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "-1"))
	int32 Lookahead = -1;

	/** Low-pass filter of the body's motion, standard deviation in frames: 0 turns it off, -1 for the default. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "-1", ClampMax = "1.5"))
	float Smoothing = -1.0f;

	/** Guidance strength of the prompt, for models that support it. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "1", ClampMax = "3"))
	float Guidance = 1.0f;

	/** Keyframes of future speech to use, for models that support it; adds that much latency. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (ClampMin = "0"))
	int32 Horizon = 0;

	/** Custom gestures for PlayGesture. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	TArray<FUmoGestureFile> Gestures;

	/** Language of the words of HintWords: en or de. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	FString Language = TEXT("en");

	/** Your own word rules in TOML, added to the language's. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo", meta = (MultiLine = "true"))
	FString WordRules;

	/** Behaviour while no audio arrives. A silent submix counts as audio. */
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

	/** Prompt: a mood, a style. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	FString Prompt;

	/** The same seed and speech give the same motion. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	int64 Seed = 0;

	/** Delay speech until its motion is ready. Off, as for a microphone, it is heard at once. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing")
	bool bDelaySpeech = true;

	/**
	 * Without delayed speech, the mouth moves with the sound and the body follows, if the model has a mouth network. Off,
	 * mouth and body lag the sound by GetDelay.
	 */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (EditCondition = "!bDelaySpeech"))
	bool bLiveVoice = true;

	/** Time reserved for computing in seconds, in addition to the future speech that frames need. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (ClampMin = "0", ClampMax = "5"))
	float Margin = 0.2f;

	/** Seconds from the mixer to the loudspeaker: about 0.2 for Bluetooth. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo|Timing", meta = (ClampMin = "0", ClampMax = "1"))
	float OutputLatency = 0.04f;

	/**
	 * Output MouthClose as the model computes it. Off, it is 0 and subtracted from JawOpen: for MetaHumans, whose
	 * Face_AnimBP adds its own animation for MouthClose.
	 */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	bool bMouthClose = true;

	/** Name of the Live Link subject, None to disable. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	FName LiveLinkSubject;

	/** Called when the model cannot be opened or the avatar has stopped for good. */
	UPROPERTY(BlueprintAssignable, Category = "Umo")
	FUmoFailed OnFailed;

	/** Interrupts the avatar: drops speech that was not heard yet and eases to rest. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	void Interrupt(float EaseSeconds = 0.3f);

	/** Sets the prompt from the next chunk on; empty removes it. False if the model takes no text. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetPrompt(const FString& Text);

	/**
	 * Speech for the Umo Voice: mono, full scale 1, at its rate; any amount, on the game thread. Returns the number of
	 * samples that fitted into the buffer of thirty seconds.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	int32 PushAudio(const TArray<float>& Samples);

	/**
	 * Plays a take of the same model, the bytes of a .umo file, until StopTake: the recorded motion from now on, idle after
	 * its end. Begin its sound at the same time, outside the submix. False if it cannot be played: OnFailed is not called,
	 * and the log says why.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PlayTake(const TArray<uint8>& Take);

	/** Plays the take in a file, relative to Content. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PlayTakeFile(const FString& File);

	/** Returns to the avatar's own motion. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	void StopTake();

	/** Whether a take plays that has not ended. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	bool IsPlayingTake() const;

	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetGain(EUmoPart Part, float Gain);

	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetIdle(EUmoIdle NewIdle);

	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetAttention(EUmoAttention NewAttention);

	/** Changes are blended over a second. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetMood(EUmoMood NewMood, float Strength = 1.0f);

	/** How far body and face follow the arousal of the voice, 0 to 1; 0.5 by default. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetExpression(float Amount);

	/** How often hands leave rest, 0 to 1: 0.5 is as people do, 0 hardly ever, 1 nearly always. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetActivity(float Amount);

	/** Strength of a layer over the model's motion, 0 to 1. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetLayer(EUmoLayer Layer, float Strength);

	/** Looks at a point of the world, eyes first; a strength of 0 stops it. May be called every tick. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool LookAt(const FVector& WorldPoint, float Strength = 1.0f);

	/**
	 * Schedules a lip shape for a sound, as timed by a speech synthesiser. Start is on the clock of GetGivenSeconds, to be
	 * read when the speech starts to play. Accurate to one buffer of the audio device. False if 64 are queued.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool HintLips(EUmoLips Shape, float Start, float Duration = 0.08f);

	/**
	 * Gives a word and its time, as timed by a speech synthesiser: some words become gestures. Start and End are on the
	 * clock of GetGivenSeconds. False if 64 are queued.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool HintWords(const FString& Text, float Start, float End);

	/** Seconds of audio that the avatar has received so far, including silence of the submix. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	float GetGivenSeconds() const;

	/**
	 * Plays a gesture over the motion as soon as possible: one of GetGestureNames, such as wave, nod or thumbs_up. Variant 0
	 * is the gesture as drawn, others differ a little.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PlayGesture(const FString& Gesture, EUmoSide Side = EUmoSide::Auto, float Strength = 1.0f, uint8 Variant = 0);

	/** Plays a pointing gesture at a point of the world. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PlayGestureAt(const FString& Gesture, const FVector& WorldPoint, EUmoSide Side = EUmoSide::Auto, float Strength = 1.0f, uint8 Variant = 0);

	UFUNCTION(BlueprintPure, Category = "Umo")
	TArray<FString> GetGestureNames() const;

	/**
	 * The interlocutor's audio, so that the avatar listens: mono, full scale 1, at the rate of its own speech; on the game
	 * thread. Only its loudness counts.
	 */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PushOtherAudio(const TArray<float>& Samples);

	/** Whether the mouth moves with the sound: speech is not delayed, and the model has a mouth network. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	bool IsLive() const;

	/** Seconds from incoming speech to its motion, and to its sound if bDelaySpeech is on. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	float GetDelay() const;

	/** Arousal of the voice that is shown, 0 to 1; 0.5 for an ordinary voice, and for none. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	float GetArousal() const;

	/** Change of the arousal per second, over the last seconds. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	float GetArousalTrend() const;

	/** Reason why the last call returned false. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	FString GetLastError() const;

	/** The pose of this tick. For the game thread. */
	const FUmoFrame& GetFrame() const { return Frame; }

	virtual void BeginPlay() override;
	virtual void EndPlay(const EEndPlayReason::Type EndPlayReason) override;
	virtual void TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction) override;

private:
	friend class UUmoSceneComponent;

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
