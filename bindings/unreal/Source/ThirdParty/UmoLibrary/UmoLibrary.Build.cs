// SPDX-License-Identifier: MIT OR Apache-2.0

using System.IO;
using UnrealBuildTool;

// The library with its headers and the default model, which fetch-native copies into the plugin.
public class UmoLibrary : ModuleRules
{
    public UmoLibrary(ReadOnlyTargetRules Target) : base(Target)
    {
        Type = ModuleType.External;

        PublicSystemIncludePaths.Add("$(PluginDir)/Source/ThirdParty/UmoLibrary/include");

        // umo_model_load needs a separate file, so the model must not be packed into a pak.
        RuntimeDependencies.Add("$(PluginDir)/Models/umo-people.safetensors", StagedFileType.NonUFS);

        if (Target.Platform == UnrealTargetPlatform.Win64)
        {
            string Library = "$(PluginDir)/Binaries/ThirdParty/UmoLibrary/Win64/";
            PublicAdditionalLibraries.Add(Library + "umo.dll.lib");
            // The module loads it from there before the first call.
            PublicDelayLoadDLLs.Add("umo.dll");
            RuntimeDependencies.Add(Library + "umo.dll");
        }
        else if (Target.Platform == UnrealTargetPlatform.Linux || Target.Platform == UnrealTargetPlatform.LinuxArm64)
        {
            string Library = "$(PluginDir)/Binaries/ThirdParty/UmoLibrary/" + Target.Platform + "/";
            PublicAdditionalLibraries.Add(Library + "libumo.so");
            PublicDelayLoadDLLs.Add(Library + "libumo.so");
            // The loader looks for the soname.
            RuntimeDependencies.Add(Library + "libumo.so.0");
        }
        else if (Target.Platform == UnrealTargetPlatform.Mac)
        {
            string Library = "$(PluginDir)/Binaries/ThirdParty/UmoLibrary/Mac/";
            PublicAdditionalLibraries.Add(Library + "libumo.dylib");
            PublicDelayLoadDLLs.Add(Library + "libumo.dylib");
            RuntimeDependencies.Add(Library + "libumo.dylib");
        }
        else if (Target.Platform == UnrealTargetPlatform.Android)
        {
            // The other half: the named file says how to add it to the application.
            PublicAdditionalLibraries.Add("$(PluginDir)/Binaries/ThirdParty/UmoLibrary/Android/arm64-v8a/libumo.so");
            AdditionalPropertiesForReceipt.Add("AndroidPlugin", Path.Combine(ModuleDirectory, "UmoLibrary_UPL.xml"));
        }
        else
        {
            throw new BuildException("umo: no library for " + Target.Platform);
        }

        string Header = Path.Combine(ModuleDirectory, "include", "umo.h");
        if (!File.Exists(Header))
        {
            throw new BuildException("umo: " + Header + " is missing: run fetch-native first, see the plugin's README");
        }
    }
}
