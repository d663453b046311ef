// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <memory>

#include "CoreMinimal.h"
#include "Animation/AnimNodeBase.h"

#include "UmoComponent.h"

#include "AnimNode_UmoPose.generated.h"

class USkeletalMesh;

namespace umo_unreal
{
class Retarget;
struct Surface;
}

/** Applies the pose of the actor's Umo component to this skeleton, over the source pose. Bones that it does not
 * drive keep the source pose. */
USTRUCT(BlueprintInternalUseOnly)
struct UMO_API FAnimNode_UmoPose : public FAnimNode_Base
{
	GENERATED_BODY()

	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = Links)
	FPoseLink SourcePose;

	/** Weight of the pose, 0 to 1. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = Settings, meta = (PinShownByDefault, ClampMin = "0", ClampMax = "1"))
	float Alpha = 1.0f;

	/** Whether bones are rotated. Turn off on a face mesh that follows the body. */
	UPROPERTY(EditAnywhere, Category = Settings)
	bool bBody = true;

	/** Whether curves are set: the 52 ARKit curves, by name. */
	UPROPERTY(EditAnywhere, Category = Settings)
	bool bCurves = true;

	/** Whether the body walks about or stays in place. */
	UPROPERTY(EditAnywhere, Category = Settings)
	bool bMoves = false;

	/** Strength with which arms keep out of the body, whose girth is measured on the skeletal mesh; 0: not. Above 0 the library's
	 * retargeter moves the bones. In packaged games the mesh needs Allow CPU Access; without it, the body has a person's
	 * proportions. */
	UPROPERTY(EditAnywhere, Category = Settings, meta = (ClampMin = "0", ClampMax = "1"))
	float Volume = 0.0f;

	/** Bone for each joint, if the skeleton's names are not the mannequin's; None leaves a joint out. */
	UPROPERTY(EditAnywhere, Category = Settings)
	TMap<FName, FName> BoneOverrides;

	virtual void Initialize_AnyThread(const FAnimationInitializeContext& Context) override;
	virtual void CacheBones_AnyThread(const FAnimationCacheBonesContext& Context) override;
	virtual void Update_AnyThread(const FAnimationUpdateContext& Context) override;
	virtual void Evaluate_AnyThread(FPoseContext& Output) override;
	virtual void GatherDebugData(FNodeDebugData& DebugData) override;
	virtual bool HasPreUpdate() const override { return true; }
	virtual void PreUpdate(const UAnimInstance* InAnimInstance) override;

private:
	void BuildRetarget(const FBoneContainer& Bones);
	void ApplyBody(FPoseContext& Output, float Weight);

	TWeakObjectPtr<const UUmoComponent> Component;
	/** The mesh at rest, and the asset that it was read from. Read on the game's thread. */
	std::shared_ptr<const umo_unreal::Surface> Surface;
	TWeakObjectPtr<const USkeletalMesh> SurfaceOf;
	/** A copy, because the component ticks while animation threads evaluate. */
	FUmoFrame Frame;
	/** Rebuilt when the bones or the avatar change; null if that failed. */
	std::shared_ptr<umo_unreal::Retarget> Retarget;
	/** Seconds since the retargeter had a pose. */
	float SinceApplied = 0.0f;
	/** Skeleton that it was built for. */
	std::shared_ptr<const umo_unreal::SourceSkeleton> RetargetedFrom;
};
