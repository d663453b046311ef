// SPDX-License-Identifier: MIT OR Apache-2.0

#include "AnimNode_UmoPose.h"

#include "Animation/AnimInstance.h"
#include "Animation/AnimInstanceProxy.h"
#include "BoneContainer.h"
#include "GameFramework/Actor.h"
#include "ReferenceSkeleton.h"

#include "Core/Retarget.h"
#include "UmoModule.h"

namespace
{
umo_unreal::Bone ToCore(const FName& Name, int32 Parent, const FTransform& Local)
{
	const FQuat Q = Local.GetRotation();
	const FVector T = Local.GetTranslation();
	return {TCHAR_TO_UTF8(*Name.ToString()), Parent, {Q.X, Q.Y, Q.Z, Q.W}, {T.X, T.Y, T.Z}};
}
}

void FAnimNode_UmoPose::Initialize_AnyThread(const FAnimationInitializeContext& Context)
{
	FAnimNode_Base::Initialize_AnyThread(Context);
	SourcePose.Initialize(Context);
}

void FAnimNode_UmoPose::CacheBones_AnyThread(const FAnimationCacheBonesContext& Context)
{
	FAnimNode_Base::CacheBones_AnyThread(Context);
	SourcePose.CacheBones(Context);
	// Another mesh may have other bones.
	RetargetedFrom.reset();
}

void FAnimNode_UmoPose::PreUpdate(const UAnimInstance* InAnimInstance)
{
	if (!Component.IsValid())
	{
		const AActor* Owner = InAnimInstance->GetOwningActor();
		Component = Owner != nullptr ? Owner->FindComponentByClass<UUmoComponent>() : nullptr;
	}
	if (const UUmoComponent* Found = Component.Get())
	{
		// The arrays keep their capacity: no allocation after the first time.
		Frame = Found->GetFrame();
	}
	else
	{
		Frame.Skeleton.reset();
	}
}

void FAnimNode_UmoPose::Update_AnyThread(const FAnimationUpdateContext& Context)
{
	SourcePose.Update(Context);
	GetEvaluateGraphExposedInputs().Execute(Context);
}

void FAnimNode_UmoPose::Evaluate_AnyThread(FPoseContext& Output)
{
	SourcePose.Evaluate(Output);
	const float Weight = FMath::Clamp(Alpha, 0.0f, 1.0f);
	if (!Frame.Skeleton || Weight <= 0.0f)
	{
		return;
	}
	if (bBody)
	{
		if (RetargetedFrom != Frame.Skeleton)
		{
			BuildRetarget(Output.Pose.GetBoneContainer());
		}
		ApplyBody(Output, Weight);
	}
	if (bCurves)
	{
		for (int32 i = 0; i < Frame.CurveNames.Num(); ++i)
		{
			const FName Name = Frame.CurveNames[i];
			Output.Curve.Set(Name, FMath::Lerp(Output.Curve.Get(Name), Frame.Curves[i], Weight));
		}
	}
}

void FAnimNode_UmoPose::BuildRetarget(const FBoneContainer& Bones)
{
	RetargetedFrom = Frame.Skeleton;
	const FReferenceSkeleton& Reference = Bones.GetReferenceSkeleton();
	const TArray<FTransform>& Rest = Reference.GetRefBonePose();
	std::vector<umo_unreal::Bone> Skeleton;
	for (int32 i = 0; i < Reference.GetNum(); ++i)
	{
		Skeleton.push_back(ToCore(Reference.GetBoneName(i), Reference.GetParentIndex(i), Rest[i]));
	}
	std::vector<umo_unreal::Override> Overrides;
	for (const TPair<FName, FName>& Given : BoneOverrides)
	{
		const FString Bone = Given.Value.IsNone() ? FString() : Given.Value.ToString();
		Overrides.push_back({TCHAR_TO_UTF8(*Given.Key.ToString()), TCHAR_TO_UTF8(*Bone)});
	}
	std::string Problem;
	Retarget = std::make_shared<umo_unreal::Retarget>();
	if (!Retarget->build(Skeleton, *Frame.Skeleton, Overrides, Problem))
	{
		UE_LOG(LogUmo, Warning, TEXT("Umo Pose moves no bones: %s"), UTF8_TO_TCHAR(Problem.c_str()));
		Retarget.reset();
	}
}

void FAnimNode_UmoPose::ApplyBody(FPoseContext& Output, float Weight)
{
	if (!Retarget)
	{
		return;
	}
	const float Translation[3] = {Frame.Translation.X, Frame.Translation.Y, Frame.Translation.Z};
	Retarget->apply(Frame.Rotations.GetData(), Translation, bMoves);
	const FBoneContainer& Bones = Output.Pose.GetBoneContainer();
	for (const umo_unreal::Driven& Driven : Retarget->driven())
	{
		// Bones may be absent at this level of detail.
		const FCompactPoseBoneIndex Index = Bones.MakeCompactPoseIndex(FMeshPoseBoneIndex(Driven.bone));
		if (!Index.IsValid())
		{
			continue;
		}
		FTransform& Bone = Output.Pose[Index];
		const umo_unreal::Quat& Q = Driven.rotation;
		Bone.SetRotation(FQuat::Slerp(Bone.GetRotation(), FQuat(Q.x, Q.y, Q.z, Q.w), Weight));
		if (Driven.bone == Retarget->pelvis())
		{
			const umo_unreal::Vec3 Place = Retarget->pelvis_translation();
			Bone.SetTranslation(FMath::Lerp(Bone.GetTranslation(), FVector(Place.x, Place.y, Place.z), static_cast<double>(Weight)));
		}
	}
}

void FAnimNode_UmoPose::GatherDebugData(FNodeDebugData& DebugData)
{
	DebugData.AddDebugItem(FString::Printf(TEXT("%s (%s)"), *DebugData.GetNodeName(this), Frame.Skeleton ? TEXT("speaks") : TEXT("no Umo component")));
	SourcePose.GatherDebugData(DebugData);
}
