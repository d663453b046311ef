// SPDX-License-Identifier: MIT OR Apache-2.0
// Generated from umo-capi/src by umo-capi/header: change it there.

#pragma once

#include "CoreMinimal.h"
#include "Subsystems/EngineSubsystem.h"

#include "UmoEngineSettings.generated.h"

/** Priority of an engine's own threads. */
UENUM()
enum class EUmoPriority : uint8
{
	/** Default priority of the process's new threads. */
	Normal = 0,
	/**
	 * Priority above normal: frames are nearly as fast beside a program that keeps every core busy. Linux refuses it to most
	 * users; Windows, Android and Apple's systems grant it.
	 */
	High = 1,
	/** Priority below normal: threads use the time that others leave. */
	Low = 2,
};

/** Kinds of cores that an engine's own threads run on. */
UENUM()
enum class EUmoCoreKinds : uint8
{
	/**
	 * On a machine with fast and slow cores: a crowd on the kind whose cores are the fastest together; what one slower core
	 * computes with room to spare, on that core, unless the priority is high.
	 */
	Auto = 0,
	/** Threads run wherever the system puts them. */
	System = 1,
	/** The fastest kind of cores alone. */
	Performance = 2,
	/** The slowest kind of cores that is not low-power, alone. */
	Efficiency = 3,
};

/** Settings of engines, read when a model is opened. 0 is the library's default. */
UCLASS(Abstract, Config = Game)
class UMO_API UUmoEngineSettings : public UEngineSubsystem
{
	GENERATED_BODY()

public:
	/**
	 * Number of compute threads, 1 to 64. With `Polled` the polling thread is one of them, and the engine starts the others
	 * unless `jobs` lends them.
	 */
	UPROPERTY(Config)
	int32 Threads = 0;

	/** Maximum number of sessions at once, 1 to 4,096. */
	UPROPERTY(Config)
	int32 MaxSessions = 0;

	/** Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need more memory. */
	UPROPERTY(Config)
	int32 MaxBatch = 0;

	/**
	 * Priority of the engine's own threads: one of `EUmoPriority`. If the system refuses it, they run at `Normal`, and `log`
	 * gets a warning that says what would permit it.
	 */
	UPROPERTY(Config)
	EUmoPriority Priority = EUmoPriority::Normal;

	/**
	 * Batching window, milliseconds: the longest that a due chunk waits for others to be computed with. With 50 ms, 32 avatars
	 * take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at the start of a
	 * stream, once at most half of its length is left until it would be late, or if all sessions are due. 0: no chunk waits.
	 */
	UPROPERTY(Config)
	int32 BatchWindowMs = 0;

	/**
	 * Kinds of cores that the engine's own threads run on if `core_count` is 0: one of `EUmoCoreKinds`. All but `System` start
	 * at most as many threads as the kind has cores. No effect where all cores are of one kind.
	 */
	UPROPERTY(Config)
	EUmoCoreKinds CoreKinds = EUmoCoreKinds::Auto;

	/** Sets fields of a `umo_engine_config`. */
	template <typename T>
	void Configure(T& Config) const
	{
		if (Threads > 0) Config.threads = static_cast<uint32>(Threads);
		if (MaxSessions > 0) Config.max_sessions = static_cast<uint32>(MaxSessions);
		if (MaxBatch > 0) Config.max_batch = static_cast<uint32>(MaxBatch);
		if (Priority > EUmoPriority::Normal) Config.priority = static_cast<uint32>(Priority);
		if (BatchWindowMs > 0) Config.batch_window_ms = static_cast<uint32>(BatchWindowMs);
		if (CoreKinds > EUmoCoreKinds::Auto) Config.core_kinds = static_cast<uint32>(CoreKinds);
	}
};
