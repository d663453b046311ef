// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <memory>

#include "CoreMinimal.h"
#include "Components/ActorComponent.h"
#include "GameFramework/Actor.h"

#include "UmoSceneComponent.generated.h"

class UUmoComponent;

namespace umo_unreal
{
class Scene;
struct Standing;
}

/** Parts that a scene plays of a member: values of UMO_SCENE_. */
UENUM(BlueprintType, meta = (Bitflags, UseEnumValuesAsMaskValuesInEditor = "true"))
enum class EUmoScenePart : uint8
{
	None = 0 UMETA(Hidden),
	/** At whom it looks, and away. */
	Look = 1,
	/** Nods and raised brows while it listens. */
	Nod = 2,
	/** Half smiles while it listens. */
	Smile = 4,
	/** Lean and shifts of weight. */
	Mirror = 8,
	/** Giving way to who interrupts it. */
	Yield = 16,
};

/** Role of a member of a scene: values of UMO_ROLE_. */
UENUM(BlueprintType)
enum class EUmoRole : uint8
{
	/** Nobody speaks. */
	Idle = 0,
	/** Another member speaks. */
	Listening = 1,
	/** It speaks. */
	Speaking = 2,
};

/** A member of a scene: an actor with a Umo component, or a person, such as the player's pawn. */
USTRUCT(BlueprintType)
struct UMO_API FUmoSceneMember
{
	GENERATED_BODY()

	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	TObjectPtr<AActor> Actor;

	/** Height of an avatar's eyes above the floor in centimetres; 0 for that of the mesh's bone "head". */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo", meta = (ClampMin = "0"))
	float EyeHeight = 0.0f;

	/** Target of its looks, whatever is said: a member, or any actor. None: the scene chooses. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo")
	TObjectPtr<AActor> LookAt;

	/** The parts that the scene plays of an avatar. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Umo", meta = (Bitmask, BitmaskEnum = "/Script/Umo.EUmoScenePart"))
	int32 Parts = 31;

	/** Place in the scene; INDEX_NONE before it is there. */
	int32 Slot = INDEX_NONE;
	int32 SentParts = 31;
	bool bLooks = false;
};

DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FUmoFloorChanged, AActor*, Speaker);

/**
 * Avatars that know each other: who speaks has the floor, the others look there, nod and make room. Put it on any actor.
 * It ticks before the members' Umo components.
 */
UCLASS(ClassGroup = (Umo), meta = (BlueprintSpawnableComponent))
class UMO_API UUmoSceneComponent : public UActorComponent
{
	GENERATED_BODY()

public:
	UUmoSceneComponent();

	/** Up to 32. After play has begun, use AddMember and RemoveMember. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	TArray<FUmoSceneMember> Members;

	/** The random choices of the scene follow from it. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Umo")
	int64 Seed = 0;

	/** Called when another member has the floor, or nobody. */
	UPROPERTY(BlueprintAssignable, Category = "Umo")
	FUmoFloorChanged OnFloorChanged;

	/** Adds an actor: an avatar if it has a Umo component, else a person, whose voice comes by PushAudio. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	void AddMember(AActor* Actor);

	/** Removes a member. Its avatar goes on alone. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	void RemoveMember(AActor* Actor);

	/** Makes a member look at another member or any actor, whatever is said; with none the scene chooses again. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetTarget(AActor* Member, AActor* Target);

	/** Sets the parts that the scene plays of a member. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool SetAllowed(AActor* Member, UPARAM(meta = (Bitmask, BitmaskEnum = "/Script/Umo.EUmoScenePart")) int32 Parts);

	/** A person's voice, as from a microphone: any rate, full scale 1; on the game thread. Only its loudness counts. */
	UFUNCTION(BlueprintCallable, Category = "Umo")
	bool PushAudio(AActor* Person, const TArray<float>& Samples);

	/** The member that has the floor; none for nobody. */
	UFUNCTION(BlueprintPure, Category = "Umo")
	AActor* GetFloor() const;

	UFUNCTION(BlueprintPure, Category = "Umo")
	EUmoRole GetRole(AActor* Member) const;

	virtual void BeginPlay() override;
	virtual void EndPlay(const EEndPlayReason::Type EndPlayReason) override;
	virtual void TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction) override;

private:
	FUmoSceneMember* Find(const AActor* Actor);
	const FUmoSceneMember* Find(const AActor* Actor) const;
	bool Follow(FUmoSceneMember& Member);
	bool Look(FUmoSceneMember& Member);
	bool Works(int32 Status);

	std::shared_ptr<umo_unreal::Scene> Scene;
	TWeakObjectPtr<AActor> Floor;
};
