// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include "CoreMinimal.h"
#include "Modules/ModuleInterface.h"

DECLARE_LOG_CATEGORY_EXTERN(LogUmo, Log, All);

/** Loads the library where the system does not find it by itself. */
class FUmoModule : public IModuleInterface
{
public:
	static FUmoModule& Get();

	/** Why the library cannot be used; empty where it can. */
	const FString& GetProblem() const { return Problem; }

	virtual void StartupModule() override;
	virtual void ShutdownModule() override;

private:
	void* Library = nullptr;
	FString Problem;
};
