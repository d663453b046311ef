// SPDX-License-Identifier: MIT OR Apache-2.0

#include "UmoModule.h"

#include "HAL/PlatformProcess.h"
#include "Interfaces/IPluginManager.h"
#include "Misc/Paths.h"
#include "Modules/ModuleManager.h"

DEFINE_LOG_CATEGORY(LogUmo);

FUmoModule& FUmoModule::Get()
{
	return FModuleManager::GetModuleChecked<FUmoModule>(TEXT("Umo"));
}

void FUmoModule::StartupModule()
{
#if PLATFORM_WINDOWS
	// Delay-loaded: Windows does not search the plugin's folder, so the library must be loaded before the first call.
	const FString BaseDir = IPluginManager::Get().FindPlugin(TEXT("Umo"))->GetBaseDir();
	const FString File = FPaths::Combine(BaseDir, TEXT("Binaries/ThirdParty/UmoLibrary/Win64/umo.dll"));
	Library = FPlatformProcess::GetDllHandle(*File);
	if (Library == nullptr)
	{
		Problem = FString::Printf(TEXT("%s cannot be loaded: run fetch-native, see the plugin's README"), *File);
		UE_LOG(LogUmo, Error, TEXT("%s"), *Problem);
	}
#endif
}

void FUmoModule::ShutdownModule()
{
	if (Library != nullptr)
	{
		FPlatformProcess::FreeDllHandle(Library);
		Library = nullptr;
	}
}

IMPLEMENT_MODULE(FUmoModule, Umo)
