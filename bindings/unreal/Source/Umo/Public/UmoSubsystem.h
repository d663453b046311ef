// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <memory>

#include "CoreMinimal.h"
#include "Subsystems/EngineSubsystem.h"

#include "UmoSubsystem.generated.h"

namespace umo_unreal
{
class Hosts;
struct Host;
}

/** Priority of the computing threads among all threads of the machine. */
UENUM()
enum class EUmoPriority : uint8
{
	Normal = 0,
	/** Above threads of normal priority: frames arrive in time while the game keeps every core busy. Linux refuses it
	 * to most users. */
	High = 1,
	/** Below threads of normal priority: the game takes precedence. */
	Low = 2,
};

/** Models and engines shared by all characters of the process: one per model file. */
UCLASS(Config = Game)
class UMO_API UUmoSubsystem : public UEngineSubsystem
{
	GENERATED_BODY()

public:
	/** Computing threads per model, 0 for the library's default of two. Read when a model is opened. */
	UPROPERTY(Config)
	int32 Threads = 0;

	/** Priority of those threads. Read when a model is opened. */
	UPROPERTY(Config)
	EUmoPriority Priority = EUmoPriority::Normal;

	/**
	 * Batching window: the longest time that a chunk waits for others, in milliseconds. With 50, 32 avatars take about a
	 * fifth less processor time, and frames are delayed by the wait. Read when a model is opened.
	 */
	UPROPERTY(Config)
	int32 GatherMs = 0;

	/** Frees the models that no character uses. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	void FreeUnusedModels();

	/** The host of a model file, null on failure; an empty path opens the plugin's model. */
	std::shared_ptr<umo_unreal::Host> Open(const FString& ModelFile, FString& OutProblem);

	virtual void Initialize(FSubsystemCollectionBase& Collection) override;
	virtual void Deinitialize() override;

private:
	std::shared_ptr<umo_unreal::Hosts> Hosts;
};
