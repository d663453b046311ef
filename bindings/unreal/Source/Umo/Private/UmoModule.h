// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include "CoreMinimal.h"
#include "Modules/ModuleInterface.h"

DECLARE_LOG_CATEGORY_EXTERN(LogUmo, Log, All);

/** Loads the library if the system cannot find it. */
class FUmoModule : public IModuleInterface
{
public:
	static FUmoModule& Get();

	/** Reason why the library cannot be used; else empty. */
	const FString& GetProblem() const { return Problem; }

	virtual void StartupModule() override;
	virtual void ShutdownModule() override;

private:
	void* Library = nullptr;
	FString Problem;
};
