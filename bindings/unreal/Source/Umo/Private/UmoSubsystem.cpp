// SPDX-License-Identifier: MIT OR Apache-2.0

#include "UmoSubsystem.h"

#include "Interfaces/IPluginManager.h"
#include "Misc/FileHelper.h"
#include "Misc/Paths.h"

#include "Core/Avatar.h"
#include "UmoModule.h"

void UUmoSubsystem::Initialize(FSubsystemCollectionBase& Collection)
{
	Super::Initialize(Collection);
	Hosts = std::make_shared<umo_unreal::Hosts>();
}

void UUmoSubsystem::Deinitialize()
{
	// The library is unloaded with the module, after this.
	Hosts.reset();
	Super::Deinitialize();
}

void UUmoSubsystem::FreeUnusedModels()
{
	Hosts->close_unused();
}

std::shared_ptr<umo_unreal::Host> UUmoSubsystem::Open(const FString& ModelFile, FString& OutProblem)
{
	const FString Missing = FUmoModule::Get().GetProblem();
	if (!Missing.IsEmpty())
	{
		OutProblem = Missing;
		return nullptr;
	}
	FString File = ModelFile;
	if (File.IsEmpty())
	{
		File = FPaths::Combine(IPluginManager::Get().FindPlugin(TEXT("Umo"))->GetBaseDir(), TEXT("Models"), TEXT("umo-people.safetensors"));
	}
	else if (FPaths::IsRelative(File))
	{
		File = FPaths::Combine(FPaths::ProjectContentDir(), File);
	}
	umo_engine_config Config = umo::engine::defaults();
	Configure(Config);
	std::string Problem;
#if PLATFORM_ANDROID
	// The file is packed in the application's archive, which the engine can read.
	TArray<uint8> Content;
	const std::string Name = TCHAR_TO_UTF8(*File);
	if (!Hosts->has(Name) && !FFileHelper::LoadFileToArray(Content, *File))
	{
		OutProblem = FString::Printf(TEXT("%s cannot be read"), *File);
		return nullptr;
	}
	auto Host = Hosts->open(Name, Config, Problem, Content.GetData(), static_cast<std::size_t>(Content.Num()));
#else
	File = FPaths::ConvertRelativePathToFull(File);
	auto Host = Hosts->open(TCHAR_TO_UTF8(*File), Config, Problem);
#endif
	OutProblem = UTF8_TO_TCHAR(Problem.c_str());
	return Host;
}
