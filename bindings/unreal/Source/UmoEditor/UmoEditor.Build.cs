// SPDX-License-Identifier: MIT OR Apache-2.0

using UnrealBuildTool;

public class UmoEditor : ModuleRules
{
    public UmoEditor(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;

        PublicDependencyModuleNames.AddRange(new string[] { "Core", "CoreUObject", "Engine", "AnimGraph", "Umo" });
        PrivateDependencyModuleNames.AddRange(new string[] { "BlueprintGraph" });
    }
}
