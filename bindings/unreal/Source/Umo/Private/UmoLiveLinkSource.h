// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include "CoreMinimal.h"
#include "ILiveLinkSource.h"

struct FUmoFrame;

namespace umo_unreal
{
struct SourceSkeleton;
}

/** One Live Link subject of the animation role with the library's 55 joints and face curves. For the game thread. */
class FUmoLiveLinkSource : public ILiveLinkSource
{
public:
	explicit FUmoLiveLinkSource(FName InSubject) : Subject(InSubject) {}

	/** Describes the bones and curves once the client is connected. */
	void Describe(const umo_unreal::SourceSkeleton& Skeleton, const TArray<FName>& CurveNames);
	void Push(const FUmoFrame& Frame, double Now);

	virtual void ReceiveClient(ILiveLinkClient* InClient, FGuid InSourceGuid) override;
	virtual bool IsSourceStillValid() const override { return Client != nullptr; }
	virtual bool RequestSourceShutdown() override;
	virtual FText GetSourceType() const override;
	virtual FText GetSourceMachineName() const override;
	virtual FText GetSourceStatus() const override;

private:
	FName Subject;
	ILiveLinkClient* Client = nullptr;
	FGuid SourceGuid;
};
