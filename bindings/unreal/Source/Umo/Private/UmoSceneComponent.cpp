// SPDX-License-Identifier: MIT OR Apache-2.0

#include "UmoSceneComponent.h"

#include "Components/SkeletalMeshComponent.h"

#include "Core/Scene.h"
#include "UmoComponent.h"
#include "UmoModule.h"

namespace
{
/** An adult's eyes, and their height above the bone of the head. */
constexpr float HeightOfEyes = 160.0f;
constexpr float EyesAboveHead = 8.0f;

std::array<float, 3> Coordinates(const FVector& Place)
{
	return {static_cast<float>(Place.X), static_cast<float>(Place.Y), static_cast<float>(Place.Z)};
}

/** An avatar faces its actor's X axis, and its mesh stands on the floor. */
umo_unreal::Standing StandingOf(const AActor& Avatar, float EyeHeight)
{
	static const FName Head(TEXT("head"));
	umo_unreal::Standing Standing;
	FVector Floor = Avatar.GetActorLocation();
	Standing.eye_height = HeightOfEyes;
	if (const USkeletalMeshComponent* Mesh = Avatar.FindComponentByClass<USkeletalMeshComponent>())
	{
		Floor = Mesh->GetComponentLocation();
		if (Mesh->DoesSocketExist(Head))
		{
			Standing.eye_height = static_cast<float>(Mesh->GetSocketLocation(Head).Z - Floor.Z) + EyesAboveHead;
		}
	}
	if (EyeHeight > 0.0f)
	{
		Standing.eye_height = EyeHeight;
	}
	Standing.position = Coordinates(Floor);
	Standing.yaw = FMath::DegreesToRadians(static_cast<float>(Avatar.GetActorRotation().Yaw));
	return Standing;
}

/** A person is where the actor sees from. */
umo_unreal::Standing StandingOfPerson(const AActor& Person)
{
	FVector Eyes;
	FRotator View;
	Person.GetActorEyesViewPoint(Eyes, View);
	umo_unreal::Standing Standing;
	Standing.position = Coordinates(Eyes);
	Standing.position[2] -= HeightOfEyes;
	Standing.eye_height = HeightOfEyes;
	Standing.yaw = FMath::DegreesToRadians(static_cast<float>(View.Yaw));
	return Standing;
}
}

UUmoSceneComponent::UUmoSceneComponent()
{
	PrimaryComponentTick.bCanEverTick = true;
	PrimaryComponentTick.TickGroup = TG_PrePhysics;
}

void UUmoSceneComponent::BeginPlay()
{
	Super::BeginPlay();
	std::string Problem;
	Scene = umo_unreal::Scene::make(static_cast<uint64>(Seed), Problem);
	if (!Scene)
	{
		UE_LOG(LogUmo, Error, TEXT("%s: %s"), *GetOwner()->GetName(), UTF8_TO_TCHAR(Problem.c_str()));
	}
}

void UUmoSceneComponent::EndPlay(const EEndPlayReason::Type EndPlayReason)
{
	Scene.reset();
	for (FUmoSceneMember& Member : Members)
	{
		Member.Slot = INDEX_NONE;
	}
	Super::EndPlay(EndPlayReason);
}

FUmoSceneMember* UUmoSceneComponent::Find(const AActor* Actor)
{
	for (FUmoSceneMember& Member : Members)
	{
		if (Actor != nullptr && Member.Actor == Actor)
		{
			return &Member;
		}
	}
	return nullptr;
}

const FUmoSceneMember* UUmoSceneComponent::Find(const AActor* Actor) const
{
	return const_cast<UUmoSceneComponent*>(this)->Find(Actor);
}

void UUmoSceneComponent::AddMember(AActor* Actor)
{
	if (Actor != nullptr && Find(Actor) == nullptr)
	{
		FUmoSceneMember Member;
		Member.Actor = Actor;
		Members.Add(Member);
	}
}

void UUmoSceneComponent::RemoveMember(AActor* Actor)
{
	for (int32 Index = Members.Num() - 1; Index >= 0; --Index)
	{
		if (Members[Index].Actor != Actor)
		{
			continue;
		}
		if (Scene)
		{
			Scene->give_back(Members[Index].Slot);
		}
		Members.RemoveAt(Index);
	}
}

bool UUmoSceneComponent::SetTarget(AActor* Member, AActor* Target)
{
	FUmoSceneMember* Found = Find(Member);
	if (Found == nullptr || Member == Target)
	{
		return false;
	}
	Found->LookAt = Target;
	return true;
}

bool UUmoSceneComponent::SetAllowed(AActor* Member, int32 Parts)
{
	FUmoSceneMember* Found = Find(Member);
	if (Found == nullptr)
	{
		return false;
	}
	Found->Parts = Parts;
	return true;
}

bool UUmoSceneComponent::PushAudio(AActor* Person, const TArray<float>& Samples)
{
	const FUmoSceneMember* Found = Find(Person);
	return Scene && Found != nullptr && Scene->hear(Found->Slot, Samples.GetData(), static_cast<std::size_t>(Samples.Num())) == UMO_STATUS_OK;
}

AActor* UUmoSceneComponent::GetFloor() const
{
	return Floor.Get();
}

EUmoRole UUmoSceneComponent::GetRole(AActor* Member) const
{
	const FUmoSceneMember* Found = Find(Member);
	if (!Scene || Found == nullptr || !Scene->has(Found->Slot))
	{
		return EUmoRole::Idle;
	}
	return static_cast<EUmoRole>(Scene->info(Found->Slot).value.role);
}

void UUmoSceneComponent::TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction)
{
	Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
	if (!Scene)
	{
		return;
	}
	for (FUmoSceneMember& Member : Members)
	{
		if (!Follow(Member))
		{
			return;
		}
	}
	// All are in the scene now, so that each can look at any other.
	for (FUmoSceneMember& Member : Members)
	{
		if (Scene->has(Member.Slot) && !Look(Member))
		{
			return;
		}
	}
	if (!Works(Scene->update(DeltaTime)))
	{
		return;
	}
	const int32 Slot = Scene->floor();
	AActor* Speaker = nullptr;
	for (const FUmoSceneMember& Member : Members)
	{
		if (Slot >= 0 && Member.Slot == Slot)
		{
			Speaker = Member.Actor;
		}
	}
	if (Speaker != Floor.Get())
	{
		Floor = Speaker;
		OnFloorChanged.Broadcast(Speaker);
	}
}

bool UUmoSceneComponent::Follow(FUmoSceneMember& Member)
{
	const AActor* Actor = Member.Actor;
	UUmoComponent* Umo = Actor != nullptr ? Actor->FindComponentByClass<UUmoComponent>() : nullptr;
	if (Member.Slot < 0)
	{
		Member.Slot = Scene->take();
		if (Member.Slot >= 0 && Umo != nullptr)
		{
			Umo->AddTickPrerequisiteComponent(this);
		}
	}
	if (Member.Slot < 0)
	{
		return Works(UMO_STATUS_FULL);
	}
	const bool bWasThere = Scene->has(Member.Slot);
	umo_status Status = UMO_STATUS_OK;
	if (Actor == nullptr)
	{
		Status = Scene->follow(Member.Slot, nullptr, umo_unreal::Standing());
	}
	else if (Umo == nullptr)
	{
		Status = Scene->follow_person(Member.Slot, StandingOfPerson(*Actor));
	}
	else
	{
		Status = Scene->follow(Member.Slot, Umo->Avatar.get(), StandingOf(*Actor, Member.EyeHeight));
	}
	if (!bWasThere)
	{
		Member.SentParts = 31;
		Member.bLooks = false;
	}
	return Works(Status);
}

bool UUmoSceneComponent::Look(FUmoSceneMember& Member)
{
	if (Member.Parts != Member.SentParts)
	{
		Member.SentParts = Member.Parts;
		if (!Works(Scene->set_allowed(Member.Slot, static_cast<uint32>(Member.Parts) & 31u)))
		{
			return false;
		}
	}
	const AActor* Target = Member.LookAt;
	if (Target == nullptr)
	{
		const bool bLooked = Member.bLooks;
		Member.bLooks = false;
		return !bLooked || Works(Scene->look_freely(Member.Slot));
	}
	Member.bLooks = true;
	const FUmoSceneMember* Other = Find(Target);
	if (Other != nullptr && Other != &Member && Scene->has(Other->Slot))
	{
		return Works(Scene->look_at(Member.Slot, Other->Slot));
	}
	return Works(Scene->look_at(Member.Slot, Coordinates(Target->GetActorLocation())));
}

bool UUmoSceneComponent::Works(int32 Status)
{
	if (Status == UMO_STATUS_OK || Status == UMO_STATUS_BUSY)
	{
		return true;
	}
	UE_LOG(LogUmo, Error, TEXT("%s: %s"), *GetOwner()->GetName(), UTF8_TO_TCHAR(umo_unreal::explain(Status, Scene->last_error()).c_str()));
	Scene.reset();
	return false;
}
