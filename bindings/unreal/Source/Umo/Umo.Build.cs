// SPDX-License-Identifier: MIT OR Apache-2.0

using UnrealBuildTool;

public class Umo : ModuleRules
{
    public Umo(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
        CppStandard = CppStandardVersion.Cpp20;
        // The files in Private/Core know nothing of the engine and stand alone.
        bUseUnity = false;

        PublicDependencyModuleNames.AddRange(new string[] {
            "Core", "CoreUObject", "Engine", "AudioMixer", "AudioExtensions", "LiveLinkInterface",
        });
        PrivateDependencyModuleNames.AddRange(new string[] { "Projects", "UmoLibrary" });
    }
}
