// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <memory>

#include "CoreMinimal.h"

#include "UmoEngineSettings.h"

#include "UmoSubsystem.generated.h"

namespace umo_unreal
{
class Hosts;
struct Host;
}

/** Holds the models and engines that all characters of the process share: one per model file. */
UCLASS(Config = Game)
class UMO_API UUmoSubsystem : public UUmoEngineSettings
{
	GENERATED_BODY()

public:
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
