// SPDX-License-Identifier: MIT OR Apache-2.0

#include "AnimGraphNode_UmoPose.h"

#include "Modules/ModuleManager.h"

#define LOCTEXT_NAMESPACE "AnimGraphNode_UmoPose"

FText UAnimGraphNode_UmoPose::GetNodeTitle(ENodeTitleType::Type TitleType) const
{
	return LOCTEXT("Title", "Umo Pose");
}

FText UAnimGraphNode_UmoPose::GetTooltipText() const
{
	return LOCTEXT("Tooltip", "The pose and the face curves of the actor's Umo component, over the source pose");
}

FLinearColor UAnimGraphNode_UmoPose::GetNodeTitleColor() const
{
	return FLinearColor(0.1f, 0.4f, 0.5f);
}

FText UAnimGraphNode_UmoPose::GetMenuCategory() const
{
	return LOCTEXT("Category", "Umo");
}

#undef LOCTEXT_NAMESPACE

IMPLEMENT_MODULE(FDefaultModuleImpl, UmoEditor)
