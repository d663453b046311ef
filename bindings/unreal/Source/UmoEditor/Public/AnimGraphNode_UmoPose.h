// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include "CoreMinimal.h"
#include "AnimGraphNode_Base.h"

#include "AnimNode_UmoPose.h"

#include "AnimGraphNode_UmoPose.generated.h"

/** The node "Umo Pose" in the animation graph. */
UCLASS(MinimalAPI)
class UAnimGraphNode_UmoPose : public UAnimGraphNode_Base
{
	GENERATED_BODY()

public:
	UPROPERTY(EditAnywhere, Category = Settings)
	FAnimNode_UmoPose Node;

	virtual FText GetNodeTitle(ENodeTitleType::Type TitleType) const override;
	virtual FText GetTooltipText() const override;
	virtual FLinearColor GetNodeTitleColor() const override;
	virtual FText GetMenuCategory() const override;
};
