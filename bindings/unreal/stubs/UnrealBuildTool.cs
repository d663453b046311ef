// The subset of UnrealBuildTool that the Build.cs files use, and a program that prints the files they need on a
// platform. Its arguments are the plugin's folder, for which $(PluginDir) stands, and the platform.
// SPDX-License-Identifier: MIT OR Apache-2.0

using System;
using System.Collections.Generic;
using System.IO;

namespace UnrealBuildTool
{
    public class BuildException : Exception
    {
        public BuildException(string message) : base(message) { }
    }

    public struct UnrealTargetPlatform
    {
        readonly string name;
        public UnrealTargetPlatform(string name) { this.name = name; }
        public static readonly UnrealTargetPlatform Win64 = new UnrealTargetPlatform("Win64");
        public static readonly UnrealTargetPlatform Linux = new UnrealTargetPlatform("Linux");
        public static readonly UnrealTargetPlatform LinuxArm64 = new UnrealTargetPlatform("LinuxArm64");
        public static readonly UnrealTargetPlatform Mac = new UnrealTargetPlatform("Mac");
        public static readonly UnrealTargetPlatform Android = new UnrealTargetPlatform("Android");
        public static bool operator ==(UnrealTargetPlatform a, UnrealTargetPlatform b) { return a.name == b.name; }
        public static bool operator !=(UnrealTargetPlatform a, UnrealTargetPlatform b) { return a.name != b.name; }
        public override bool Equals(object other) { return other is UnrealTargetPlatform && (UnrealTargetPlatform)other == this; }
        public override int GetHashCode() { return name.GetHashCode(); }
        public override string ToString() { return name; }
    }

    public class ReadOnlyTargetRules
    {
        public UnrealTargetPlatform Platform;
    }

    public enum StagedFileType { UFS, NonUFS }
    public enum CppStandardVersion { Cpp20 }

    public class RuntimeDependencyList
    {
        public readonly List<string> Paths = new List<string>();
        public void Add(string path) { Paths.Add(path); }
        public void Add(string path, StagedFileType type) { Paths.Add(path); }
    }

    public class ReceiptPropertyList
    {
        public readonly List<KeyValuePair<string, string>> Items = new List<KeyValuePair<string, string>>();
        public void Add(string name, string value) { Items.Add(new KeyValuePair<string, string>(name, value)); }
    }

    public class ModuleRules
    {
        public enum ModuleType { CPlusPlus, External }
        public enum PCHUsageMode { UseExplicitOrSharedPCHs }

        public static string Folder;

        public ModuleRules(ReadOnlyTargetRules target) { }

        public string ModuleDirectory { get { return Folder; } }
        public ModuleType Type;
        public PCHUsageMode PCHUsage;
        public CppStandardVersion? CppStandard;
        public bool bUseUnity = true;
        public readonly List<string> PublicSystemIncludePaths = new List<string>();
        public readonly List<string> PublicAdditionalLibraries = new List<string>();
        public readonly List<string> PublicDelayLoadDLLs = new List<string>();
        public readonly List<string> PublicDependencyModuleNames = new List<string>();
        public readonly List<string> PrivateDependencyModuleNames = new List<string>();
        public readonly RuntimeDependencyList RuntimeDependencies = new RuntimeDependencyList();
        public readonly ReceiptPropertyList AdditionalPropertiesForReceipt = new ReceiptPropertyList();
    }

    static class Program
    {
        static void Main(string[] arguments)
        {
            var target = new ReadOnlyTargetRules { Platform = new UnrealTargetPlatform(arguments[1]) };
            ModuleRules.Folder = Path.Combine(arguments[0], "Source", "ThirdParty", "UmoLibrary");
            var library = new UmoLibrary(target);
            var files = new List<string>(library.PublicSystemIncludePaths);
            files.AddRange(library.PublicAdditionalLibraries);
            files.AddRange(library.RuntimeDependencies.Paths);
            foreach (string path in library.PublicDelayLoadDLLs)
            {
                if (path.Contains("/")) files.Add(path);
            }
            foreach (var item in library.AdditionalPropertiesForReceipt.Items)
            {
                if (item.Key != "AndroidPlugin") throw new BuildException("nothing reads " + item.Key);
                files.Add(item.Value);
            }
            foreach (string path in files) Console.WriteLine(path.Replace("$(PluginDir)", arguments[0]));
            // The modules' own rules must also be constructible.
            var umo = new Umo(target);
            var editor = new UmoEditor(target);
            if (!umo.PrivateDependencyModuleNames.Contains("UmoLibrary") || !editor.PublicDependencyModuleNames.Contains("Umo"))
            {
                throw new BuildException("the modules do not depend on each other");
            }
        }
    }
}
