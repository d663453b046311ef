// SPDX-License-Identifier: MIT OR Apache-2.0

#include "UmoLiveLinkSource.h"

#include "HAL/PlatformProcess.h"
#include "ILiveLinkClient.h"
#include "LiveLinkTypes.h"
#include "Roles/LiveLinkAnimationRole.h"
#include "Roles/LiveLinkAnimationTypes.h"

#include "Core/Avatar.h"
#include "UmoComponent.h"

#define LOCTEXT_NAMESPACE "UmoLiveLinkSource"

void FUmoLiveLinkSource::ReceiveClient(ILiveLinkClient* InClient, FGuid InSourceGuid)
{
	Client = InClient;
	SourceGuid = InSourceGuid;
}

bool FUmoLiveLinkSource::RequestSourceShutdown()
{
	Client = nullptr;
	return true;
}

FText FUmoLiveLinkSource::GetSourceType() const
{
	return LOCTEXT("Type", "umo");
}

FText FUmoLiveLinkSource::GetSourceMachineName() const
{
	return FText::FromString(FPlatformProcess::ComputerName());
}

FText FUmoLiveLinkSource::GetSourceStatus() const
{
	return Client != nullptr ? LOCTEXT("Active", "Active") : LOCTEXT("Closed", "Closed");
}

void FUmoLiveLinkSource::Describe(const umo_unreal::SourceSkeleton& Skeleton, const TArray<FName>& CurveNames)
{
	if (Client == nullptr)
	{
		return;
	}
	FLiveLinkStaticDataStruct Struct(FLiveLinkSkeletonStaticData::StaticStruct());
	FLiveLinkSkeletonStaticData& Data = *Struct.Cast<FLiveLinkSkeletonStaticData>();
	for (uint32 Joint = 0; Joint < umo_unreal::joint_count; ++Joint)
	{
		Data.BoneNames.Add(FName(UTF8_TO_TCHAR(umo_joint_name(Joint))));
		Data.BoneParents.Add(Skeleton.parents[Joint]);
	}
	Data.PropertyNames = CurveNames;
	Client->PushSubjectStaticData_AnyThread({SourceGuid, Subject}, ULiveLinkAnimationRole::StaticClass(), MoveTemp(Struct));
}

void FUmoLiveLinkSource::Push(const FUmoFrame& Frame, double Now)
{
	if (Client == nullptr)
	{
		return;
	}
	FLiveLinkFrameDataStruct Struct(FLiveLinkAnimationFrameData::StaticStruct());
	FLiveLinkAnimationFrameData& Data = *Struct.Cast<FLiveLinkAnimationFrameData>();
	Data.WorldTime = FLiveLinkWorldTime(Now);
	Data.PropertyValues = Frame.Curves;
	const float* Offsets = Frame.Skeleton->offsets;
	for (int32 Joint = 0; Joint < static_cast<int32>(umo_unreal::joint_count); ++Joint)
	{
		const float* Q = Frame.Rotations.GetData() + 4 * Joint;
		FVector Place(Offsets[3 * Joint], Offsets[3 * Joint + 1], Offsets[3 * Joint + 2]);
		if (Joint == 0)
		{
			Place += FVector(Frame.Translation);
		}
		Data.Transforms.Add(FTransform(FQuat(Q[0], Q[1], Q[2], Q[3]), Place));
	}
	Client->PushSubjectFrameData_AnyThread({SourceGuid, Subject}, MoveTemp(Struct));
}

#undef LOCTEXT_NAMESPACE
