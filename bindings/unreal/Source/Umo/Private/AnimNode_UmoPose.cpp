// SPDX-License-Identifier: MIT OR Apache-2.0

#include "AnimNode_UmoPose.h"

#include "Animation/AnimInstance.h"
#include "Animation/AnimInstanceProxy.h"
#include "BoneContainer.h"
#include "Components/SkeletalMeshComponent.h"
#include "Engine/SkeletalMesh.h"
#include "GameFramework/Actor.h"
#include "ReferenceSkeleton.h"
#include "Rendering/SkeletalMeshRenderData.h"

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

/** The mesh at rest; empty where the processor has no copy of it. */
umo_unreal::Surface ReadSurface(const USkeletalMesh& Mesh)
{
	umo_unreal::Surface Surface;
	const FSkeletalMeshRenderData* Data = Mesh.GetResourceForRendering();
	if (Data == nullptr || Data->LODRenderData.Num() == 0)
	{
		return Surface;
	}
	const FSkeletalMeshLODRenderData& Lod = Data->LODRenderData[0];
	const FPositionVertexBuffer& Positions = Lod.StaticVertexBuffers.PositionVertexBuffer;
	const FSkinWeightVertexBuffer* Weights = Lod.GetSkinWeightVertexBuffer();
	if (Positions.GetVertexData() == nullptr || Weights == nullptr || Weights->GetDataVertexBuffer() == nullptr
		|| Weights->GetDataVertexBuffer()->GetWeightData() == nullptr)
	{
		return Surface;
	}
	const uint32 Count = Positions.GetNumVertices();
	for (uint32 Vertex = 0; Vertex < Count; ++Vertex)
	{
		const FVector3f& At = Positions.VertexPosition(Vertex);
		Surface.vertices.insert(Surface.vertices.end(), {At.X, At.Y, At.Z});
	}
	Surface.bones.assign(Count, -1);
	for (const FSkelMeshRenderSection& Section : Lod.RenderSections)
	{
		const uint32 End = FMath::Min(Section.BaseVertexIndex + Section.NumVertices, Count);
		for (uint32 Vertex = Section.BaseVertexIndex; Vertex < End; ++Vertex)
		{
			// Influences are sorted, the largest first; weights are of 16 bits.
			const int32 Bone = static_cast<int32>(Weights->GetBoneIndex(Vertex, 0));
			if (Weights->GetBoneWeight(Vertex, 0) >= 0x8000 - 1 && Bone < Section.BoneMap.Num())
			{
				Surface.bones[Vertex] = Section.BoneMap[Bone];
			}
		}
	}
	TArray<uint32> Indices;
	Lod.MultiSizeIndexContainer.GetIndexBuffer(Indices);
	Surface.indices.assign(Indices.GetData(), Indices.GetData() + Indices.Num());
	return Surface;
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
	const USkeletalMeshComponent* Body = Volume > 0.0f ? InAnimInstance->GetSkelMeshComponent() : nullptr;
	const USkeletalMesh* Mesh = Body != nullptr ? Body->GetSkeletalMeshAsset() : nullptr;
	if (Mesh != nullptr && (SurfaceOf.Get() != Mesh || !Surface))
	{
		Surface = std::make_shared<const umo_unreal::Surface>(ReadSurface(*Mesh));
		SurfaceOf = Mesh;
		RetargetedFrom.reset();
		if (Surface->bones.empty())
		{
			UE_LOG(LogUmo, Warning, TEXT("Umo Pose: the mesh's points cannot be read, and the body has a person's girth: turn Allow CPU Access on for LOD 0"));
		}
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
	// Not every update is evaluated.
	SinceApplied += Context.GetDeltaTime();
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
	else if (Volume > 0.0f && Surface && !Retarget->set_volume(Skeleton, *Surface, FMath::Min(Volume, 1.0f), Problem))
	{
		UE_LOG(LogUmo, Warning, TEXT("Umo Pose has no volume: %s"), UTF8_TO_TCHAR(Problem.c_str()));
	}
}

void FAnimNode_UmoPose::ApplyBody(FPoseContext& Output, float Weight)
{
	if (!Retarget)
	{
		return;
	}
	const float Translation[3] = {Frame.Translation.X, Frame.Translation.Y, Frame.Translation.Z};
	Retarget->apply(Frame.Rotations.GetData(), Translation, bMoves, SinceApplied);
	SinceApplied = 0.0f;
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
