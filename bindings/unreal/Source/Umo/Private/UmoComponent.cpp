// SPDX-License-Identifier: MIT OR Apache-2.0

#include "UmoComponent.h"

#include "AudioDevice.h"
#include "Components/SkeletalMeshComponent.h"
#include "Engine/Engine.h"
#include "Engine/World.h"
#include "Features/IModularFeatures.h"
#include "GameFramework/Actor.h"
#include "HAL/PlatformTime.h"
#include "ILiveLinkClient.h"
#include "ISubmixBufferListener.h"
#include "Misc/FileHelper.h"
#include "Misc/Paths.h"
#include "Sound/SoundSubmix.h"

#include "Core/Avatar.h"
#include "UmoLiveLinkSource.h"
#include "UmoModule.h"
#include "UmoSubsystem.h"
#include "UmoVoiceComponent.h"

/** Receives a submix's audio for an avatar, which may be closed at any time. */
class FUmoSubmixListener : public ISubmixBufferListener
{
public:
	explicit FUmoSubmixListener(std::shared_ptr<umo_unreal::Avatar> InAvatar) : Avatar(MoveTemp(InAvatar)) {}

	virtual void OnNewSubmixBuffer(const USoundSubmix* OwningSubmix, float* AudioData, int32 NumSamples, int32 NumChannels, const int32 SampleRate, double AudioClock) override
	{
		if (NumChannels > 0)
		{
			Avatar->hear(AudioData, static_cast<std::size_t>(NumSamples / NumChannels), static_cast<std::size_t>(NumChannels), static_cast<uint32>(SampleRate), FPlatformTime::Seconds());
		}
	}

	/** Keeps the submix awake: one that sleeps in silence would hold back delayed speech. */
	virtual bool IsRenderingAudio() const override { return true; }

	virtual const FString& GetListenerName() const override
	{
		static const FString Name = TEXT("Umo");
		return Name;
	}

private:
	const std::shared_ptr<umo_unreal::Avatar> Avatar;
};

namespace
{
/** Thirty seconds: room for a long answer from a speech synthesiser. */
constexpr int32 SecondsOfSpeech = 30;

ILiveLinkClient* FindLiveLink()
{
	IModularFeatures& Features = IModularFeatures::Get();
	if (!Features.IsModularFeatureAvailable(ILiveLinkClient::ModularFeatureName))
	{
		return nullptr;
	}
	return &Features.GetModularFeature<ILiveLinkClient>(ILiveLinkClient::ModularFeatureName);
}

uint32 ParameterOf(EUmoPart Part)
{
	switch (Part)
	{
	case EUmoPart::Face: return UMO_PARAMETER_GAIN_FACE;
	case EUmoPart::Hands: return UMO_PARAMETER_GAIN_HANDS;
	case EUmoPart::Upper: return UMO_PARAMETER_GAIN_UPPER;
	default: return UMO_PARAMETER_GAIN_LOWER;
	}
}
}

uint32 FUmoGestureFile::Parts() const
{
	return (bHead ? UMO_GESTURE_HEAD : 0) | (bTrunk ? UMO_GESTURE_TRUNK : 0) | (bLeftArm ? UMO_GESTURE_LEFT_ARM : 0) | (bRightArm ? UMO_GESTURE_RIGHT_ARM : 0);
}

UUmoComponent::UUmoComponent()
{
	PrimaryComponentTick.bCanEverTick = true;
	PrimaryComponentTick.TickGroup = TG_PrePhysics;
}

void UUmoComponent::BeginPlay()
{
	Super::BeginPlay();
	// The pose must be ready before the meshes use it.
	TInlineComponentArray<USkeletalMeshComponent*> Meshes(GetOwner());
	for (USkeletalMeshComponent* Mesh : Meshes)
	{
		Mesh->AddTickPrerequisiteComponent(this);
	}
	Voice = GetOwner()->FindComponentByClass<UUmoVoiceComponent>();
	const UWorld* World = GetWorld();
	const FAudioDeviceHandle Device = World->GetAudioDevice();
	if (Voice.IsValid())
	{
		Open(Voice->SpeechRate);
	}
	else if (Device.IsValid())
	{
		Open(static_cast<int32>(Device->GetSampleRate()));
	}
	else
	{
		Fail(TEXT("no audio device (is this a dedicated server?)"));
	}
}

void UUmoComponent::EndPlay(const EEndPlayReason::Type EndPlayReason)
{
	Close();
	Super::EndPlay(EndPlayReason);
}

void UUmoComponent::Open(int32 SampleRate)
{
	FString Reason;
	const auto Host = GEngine->GetEngineSubsystem<UUmoSubsystem>()->Open(Model.FilePath, Reason);
	if (!Host)
	{
		Fail(Reason);
		return;
	}
	for (const FUmoGestureFile& Gesture : Gestures)
	{
		const FString File = FPaths::IsRelative(Gesture.File.FilePath) ? FPaths::Combine(FPaths::ProjectContentDir(), Gesture.File.FilePath) : Gesture.File.FilePath;
		const std::string Animation(TCHAR_TO_UTF8(*Gesture.Animation));
		const umo_status Status = Host->engine.add_gesture_file(TCHAR_TO_UTF8(*Gesture.Name), TCHAR_TO_UTF8(*FPaths::ConvertRelativePathToFull(File)),
			Animation.empty() ? nullptr : Animation.c_str(), Gesture.Parts(), Gesture.Stroke);
		if (Status != UMO_STATUS_OK)
		{
			Fail(UTF8_TO_TCHAR(umo_unreal::explain(Status, umo_last_error()).c_str()));
			return;
		}
	}
	umo_unreal::Settings Settings;
	Settings.sample_rate = static_cast<uint32>(SampleRate);
	Settings.target = static_cast<uint32>(FMath::Max(Target, 0));
	Settings.lookahead = Lookahead;
	Settings.idle = static_cast<uint32>(Idle);
	Settings.seed = static_cast<uint64>(Seed);
	Settings.smoothing = Smoothing;
	Settings.guidance = FMath::Clamp(Guidance, 1.0f, 3.0f);
	Settings.horizon = static_cast<uint32>(FMath::Max(Horizon, 0));
	Settings.margin = Margin;
	Settings.output_latency = OutputLatency;
	Settings.delays_speech = bDelaySpeech;
	Settings.has_live_voice = bLiveVoice;
	Settings.has_mouth_close = bMouthClose;
	Settings.language = TCHAR_TO_UTF8(*Language);
	Settings.word_rules = TCHAR_TO_UTF8(*WordRules);
	std::string Problem;
	Avatar = umo_unreal::Avatar::make(Host, Settings, Problem);
	if (!Avatar)
	{
		Fail(UTF8_TO_TCHAR(Problem.c_str()));
		return;
	}
	Frame.Skeleton = std::make_shared<const umo_unreal::SourceSkeleton>(Avatar->skeleton());
	Frame.Rotations.SetNumZeroed(4 * static_cast<int32>(umo_unreal::joint_count));
	Frame.CurveNames.Reset();
	for (const std::string& Name : Host->channels)
	{
		Frame.CurveNames.Add(FName(UTF8_TO_TCHAR(Name.c_str())));
	}
	Frame.Curves.SetNumZeroed(Frame.CurveNames.Num());
	LastTick = FPlatformTime::Seconds();

	SetGain(EUmoPart::Face, FaceGain);
	SetGain(EUmoPart::Hands, HandsGain);
	SetGain(EUmoPart::Upper, UpperGain);
	SetGain(EUmoPart::Lower, LowerGain);
	SetAttention(Attention);
	SetMood(Mood, MoodStrength);
	if (!Prompt.IsEmpty() && !SetPrompt(Prompt))
	{
		UE_LOG(LogUmo, Warning, TEXT("%s: the prompt is not used: %s"), *GetOwner()->GetName(), *GetLastError());
	}
	if (!StartListening())
	{
		Fail(TEXT("no speech input: choose a submix, or add a Umo Voice to the actor"));
		return;
	}
	OpenLiveLink();
}

bool UUmoComponent::StartListening()
{
	if (UUmoVoiceComponent* Speaker = Voice.Get())
	{
		Speech = std::make_shared<umo_unreal::Ring>(static_cast<std::size_t>(Speaker->SpeechRate) * SecondsOfSpeech);
		Speaker->SpeakFor(Avatar, Speech);
		Speaker->Start();
		return true;
	}
	const FAudioDeviceHandle Device = GetWorld()->GetAudioDevice();
	if (Submix == nullptr || !Device.IsValid())
	{
		return false;
	}
	Listener = MakeShared<FUmoSubmixListener, ESPMode::ThreadSafe>(Avatar);
	Device->RegisterSubmixBufferListener(Listener.ToSharedRef(), *Submix);
	return true;
}

void UUmoComponent::OpenLiveLink()
{
	if (LiveLinkSubject.IsNone())
	{
		return;
	}
	ILiveLinkClient* Client = FindLiveLink();
	if (Client == nullptr)
	{
		UE_LOG(LogUmo, Warning, TEXT("%s: the Live Link plugin is not enabled"), *GetOwner()->GetName());
		return;
	}
	LiveLink = MakeShared<FUmoLiveLinkSource>(LiveLinkSubject);
	Client->AddSource(LiveLink);
	LiveLink->Describe(*Frame.Skeleton, Frame.CurveNames);
}

void UUmoComponent::Close()
{
	if (LiveLink.IsValid())
	{
		if (ILiveLinkClient* Client = FindLiveLink())
		{
			Client->RemoveSource(LiveLink);
		}
		LiveLink.Reset();
	}
	if (UUmoVoiceComponent* Speaker = Voice.Get())
	{
		Speaker->Stop();
		Speaker->SpeakFor(nullptr, nullptr);
	}
	if (Listener.IsValid())
	{
		const FAudioDeviceHandle Device = GetWorld()->GetAudioDevice();
		if (Device.IsValid() && Submix != nullptr)
		{
			Device->UnregisterSubmixBufferListener(Listener.ToSharedRef(), *Submix);
		}
		Listener.Reset();
	}
	if (Avatar)
	{
		// The audio thread may still use it for one buffer, without effect.
		Avatar->close();
		Avatar.reset();
	}
	Frame.Skeleton.reset();
}

void UUmoComponent::Fail(const FString& Reason)
{
	UE_LOG(LogUmo, Error, TEXT("%s: %s"), *GetOwner()->GetName(), *Reason);
	Close();
	OnFailed.Broadcast(Reason);
}

void UUmoComponent::TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction)
{
	Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
	if (!Avatar)
	{
		return;
	}
	if (const uint32 Rate = Avatar->other_rate())
	{
		// The audio device has changed: a session has one sample rate.
		Close();
		Open(static_cast<int32>(Rate));
		return;
	}
	// Sound does not follow the game's time, which may be slowed.
	const double Now = FPlatformTime::Seconds();
	// Motion without speech does follow it, also in a film rendered frame by frame.
	Avatar->show(Now - LastTick, Now, DeltaTime);
	LastTick = Now;
	const umo_unreal::Pose& Pose = Avatar->pose();
	FMemory::Memcpy(Frame.Rotations.GetData(), Pose.rotations, sizeof Pose.rotations);
	FMemory::Memcpy(Frame.Curves.GetData(), Pose.channels.data(), sizeof(float) * Pose.channels.size());
	Frame.Translation = FVector3f(Pose.translation[0], Pose.translation[1], Pose.translation[2]);
	if (LiveLink.IsValid())
	{
		LiveLink->Push(Frame, Now);
	}
	const std::string Failure = Avatar->failure();
	if (!Failure.empty())
	{
		Fail(UTF8_TO_TCHAR(Failure.c_str()));
	}
}

void UUmoComponent::Interrupt(float EaseSeconds)
{
	if (Avatar)
	{
		if (UUmoVoiceComponent* Speaker = Voice.Get())
		{
			// Speech that was pushed but not played is dropped with its ring.
			Speech = std::make_shared<umo_unreal::Ring>(static_cast<std::size_t>(Speaker->SpeechRate) * SecondsOfSpeech);
			Speaker->SpeakFor(Avatar, Speech);
		}
		Avatar->interrupt(static_cast<uint32>(FMath::Clamp(EaseSeconds, 0.0f, 10.0f) * 1000.0f));
	}
}

bool UUmoComponent::SetPrompt(const FString& Text)
{
	return Avatar && Avatar->set_prompt(TCHAR_TO_UTF8(*Text)) == UMO_STATUS_OK;
}

int32 UUmoComponent::PushAudio(const TArray<float>& Samples)
{
	return Speech ? static_cast<int32>(Speech->write(Samples.GetData(), static_cast<std::size_t>(Samples.Num()))) : 0;
}

bool UUmoComponent::PlayTake(const TArray<uint8>& Take)
{
	std::string Problem = "the avatar is not open";
	const bool bPlays = Avatar && Avatar->play_take(Take.GetData(), static_cast<std::size_t>(Take.Num()), Problem) == UMO_STATUS_OK;
	if (!bPlays)
	{
		UE_LOG(LogUmo, Warning, TEXT("%s: the take is not played: %s"), *GetOwner()->GetName(), *FString(UTF8_TO_TCHAR(Problem.c_str())));
	}
	return bPlays;
}

bool UUmoComponent::PlayTakeFile(const FString& File)
{
	const FString Path = FPaths::IsRelative(File) ? FPaths::Combine(FPaths::ProjectContentDir(), File) : File;
	TArray<uint8> Take;
	if (!FFileHelper::LoadFileToArray(Take, *Path))
	{
		UE_LOG(LogUmo, Warning, TEXT("%s: %s cannot be read"), *GetOwner()->GetName(), *Path);
		return false;
	}
	return PlayTake(Take);
}

void UUmoComponent::StopTake()
{
	if (Avatar)
	{
		Avatar->stop_take();
	}
}

bool UUmoComponent::IsPlayingTake() const
{
	return Avatar && Avatar->plays_take();
}

bool UUmoComponent::SetGain(EUmoPart Part, float Gain)
{
	return Avatar && Avatar->set(ParameterOf(Part), Gain) == UMO_STATUS_OK;
}

bool UUmoComponent::SetIdle(EUmoIdle NewIdle)
{
	return Avatar && Avatar->set_idle(static_cast<uint32>(NewIdle)) == UMO_STATUS_OK;
}

bool UUmoComponent::SetAttention(EUmoAttention NewAttention)
{
	return Avatar && Avatar->set(UMO_PARAMETER_ATTENTION, static_cast<double>(NewAttention)) == UMO_STATUS_OK;
}

bool UUmoComponent::SetMood(EUmoMood NewMood, float Strength)
{
	return Avatar && Avatar->set_mood(static_cast<uint32>(NewMood), Strength) == UMO_STATUS_OK;
}

bool UUmoComponent::SetExpression(float Amount)
{
	return Avatar && Avatar->set(UMO_PARAMETER_EXPRESSION, Amount) == UMO_STATUS_OK;
}

bool UUmoComponent::SetActivity(float Amount)
{
	return Avatar && Avatar->set(UMO_PARAMETER_ACTIVITY, Amount) == UMO_STATUS_OK;
}

bool UUmoComponent::SetLayer(EUmoLayer Layer, float Strength)
{
	return Avatar && Avatar->set(UMO_PARAMETER_LAYER_GAZE + static_cast<uint32>(Layer), Strength) == UMO_STATUS_OK;
}

std::array<float, 3> UUmoComponent::InAvatarSpace(const FVector& WorldPoint) const
{
	// The actor faces its X axis; its meshes may be rotated, and stand on the floor, which need not be at the actor's
	// origin.
	const AActor* Owner = GetOwner();
	FVector Origin = Owner->GetActorLocation();
	if (const USkeletalMeshComponent* Mesh = Owner->FindComponentByClass<USkeletalMeshComponent>())
	{
		Origin = Mesh->GetComponentLocation();
	}
	const FVector Point = Owner->GetActorRotation().UnrotateVector(WorldPoint - Origin);
	return {static_cast<float>(Point.X), static_cast<float>(Point.Y), static_cast<float>(Point.Z)};
}

bool UUmoComponent::LookAt(const FVector& WorldPoint, float Strength)
{
	return Avatar && Avatar->look_at(InAvatarSpace(WorldPoint), Strength) == UMO_STATUS_OK;
}

bool UUmoComponent::HintLips(EUmoLips Shape, float Start, float Duration)
{
	return Avatar && Avatar->hint_lips(static_cast<uint32>(Shape), Start, Duration) == UMO_STATUS_OK;
}

bool UUmoComponent::HintWords(const FString& Text, float Start, float End)
{
	return Avatar && Avatar->hint_words(TCHAR_TO_UTF8(*Text), Start, End) == UMO_STATUS_OK;
}

float UUmoComponent::GetGivenSeconds() const
{
	return Avatar ? static_cast<float>(Avatar->given(FPlatformTime::Seconds())) : 0.0f;
}

bool UUmoComponent::PlayGesture(const FString& Gesture, EUmoSide Side, float Strength, uint8 Variant)
{
	return Avatar && Avatar->play_gesture(TCHAR_TO_UTF8(*Gesture), static_cast<uint32>(Side), Strength, Variant, nullptr) == UMO_STATUS_OK;
}

bool UUmoComponent::PlayGestureAt(const FString& Gesture, const FVector& WorldPoint, EUmoSide Side, float Strength, uint8 Variant)
{
	const std::array<float, 3> Point = InAvatarSpace(WorldPoint);
	return Avatar && Avatar->play_gesture(TCHAR_TO_UTF8(*Gesture), static_cast<uint32>(Side), Strength, Variant, &Point) == UMO_STATUS_OK;
}

TArray<FString> UUmoComponent::GetGestureNames() const
{
	TArray<FString> Names;
	if (Avatar)
	{
		for (const std::string& Name : Avatar->gesture_names())
		{
			Names.Add(UTF8_TO_TCHAR(Name.c_str()));
		}
	}
	return Names;
}

bool UUmoComponent::PushOtherAudio(const TArray<float>& Samples)
{
	return Avatar && Avatar->push_other_audio(Samples.GetData(), static_cast<std::size_t>(Samples.Num())) == UMO_STATUS_OK;
}

bool UUmoComponent::IsLive() const
{
	return Avatar && Avatar->is_live();
}

float UUmoComponent::GetDelay() const
{
	return Avatar ? static_cast<float>(Avatar->delay()) : 0.0f;
}

float UUmoComponent::GetArousal() const
{
	return Avatar ? Avatar->arousal() : 0.5f;
}

float UUmoComponent::GetArousalTrend() const
{
	return Avatar ? Avatar->arousal_trend() : 0.0f;
}

FString UUmoComponent::GetLastError() const
{
	return Avatar ? FString(UTF8_TO_TCHAR(Avatar->last_error().c_str())) : FString(TEXT("the avatar is not open"));
}
