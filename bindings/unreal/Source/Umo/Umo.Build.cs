// SPDX-License-Identifier: MIT OR Apache-2.0

using UnrealBuildTool;

public class Umo : ModuleRules
{
    public Umo(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
        CppStandard = CppStandardVersion.Cpp20;
        // The files in Private/Core do not use the engine and compile separately.
        bUseUnity = false;

        PublicDependencyModuleNames.AddRange(new string[] {
            "Core", "CoreUObject", "Engine", "AudioMixer", "AudioExtensions", "LiveLinkInterface",
        });
        PrivateDependencyModuleNames.AddRange(new string[] { "Projects", "RenderCore", "RHI", "UmoLibrary" });
    }
}
