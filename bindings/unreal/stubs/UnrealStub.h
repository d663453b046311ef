// The subset of Unreal Engine 5.4's API that the plugin uses, written from its documentation so that the plugin's
// source compiles without the engine: declarations only, never linked or run.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>
#include <utility>

// Core

using int32 = std::int32_t;
using int64 = std::int64_t;
using uint8 = std::uint8_t;
using uint16 = std::uint16_t;
using uint32 = std::uint32_t;
using uint64 = std::uint64_t;
using SIZE_T = std::size_t;
using TCHAR = char16_t;
using ANSICHAR = char;

#define TEXT(text) u##text
#define INDEX_NONE (-1)
#define UMO_API
#ifndef PLATFORM_WINDOWS
#define PLATFORM_WINDOWS 0
#endif
#ifndef PLATFORM_ANDROID
#define PLATFORM_ANDROID 0
#endif
#define UCLASS(...)
#define USTRUCT(...)
#define UENUM(...)
#define UPROPERTY(...)
#define UFUNCTION(...)
#define STUB_JOIN3(a, b, c) a##_##b##_##c
#define STUB_JOIN(a, b, c) STUB_JOIN3(a, b, c)
#define GENERATED_BODY() STUB_JOIN(STUB_BODY, CURRENT_FILE_ID, __LINE__)
#define UMETA(...)
#define UPARAM(...)

const TCHAR *StubToTchar(const char *);
const char *StubToUtf8(const TCHAR *);
#define UTF8_TO_TCHAR(text) StubToTchar(text)
#define TCHAR_TO_UTF8(text) StubToUtf8(text)

template <class T> std::remove_reference_t<T> &&MoveTemp(T &&value) {
    return static_cast<std::remove_reference_t<T> &&>(value);
}

class FString {
public:
    FString();
    FString(const TCHAR *);
    bool IsEmpty() const;
    const TCHAR *operator*() const;
    template <class... A> static FString Printf(const TCHAR *, A...) {
        static_assert((std::is_trivially_copyable_v<A> && ...), "dereference strings for Printf");
        return {};
    }
};
class FName {
public:
    FName();
    FName(const TCHAR *);
    bool IsNone() const;
    FString ToString() const;
    bool operator==(const FName &) const;
};
class FText {
public:
    static FText FromString(const FString &);
};
FText StubText(const char *, const char *, const char *);
#define LOCTEXT(key, text) StubText(LOCTEXT_NAMESPACE, key, text)

template <class T> class TArray {
public:
    int32 Num() const;
    int32 Add(const T &);
    void Reset();
    void SetNumZeroed(int32);
    void RemoveAt(int32);
    T *GetData();
    const T *GetData() const;
    T &operator[](int32);
    const T &operator[](int32) const;
    T *begin();
    T *end();
    const T *begin() const;
    const T *end() const;
};
template <class K, class V> struct TPair {
    K Key;
    V Value;
};
template <class K, class V> class TMap {
public:
    const TPair<K, V> *begin() const;
    const TPair<K, V> *end() const;
};

enum class ESPMode { NotThreadSafe, ThreadSafe };
template <class T, ESPMode M = ESPMode::ThreadSafe> class TSharedRef {
public:
    template <class U, class = std::enable_if_t<std::is_convertible_v<U *, T *>>> TSharedRef(const TSharedRef<U, M> &);
};
template <class T, ESPMode M = ESPMode::ThreadSafe> class TSharedPtr {
public:
    TSharedPtr();
    template <class U, class = std::enable_if_t<std::is_convertible_v<U *, T *>>> TSharedPtr(const TSharedPtr<U, M> &);
    bool IsValid() const;
    void Reset();
    T *operator->() const;
    TSharedRef<T, M> ToSharedRef() const;
};
template <class T, ESPMode M = ESPMode::ThreadSafe> class TSharedFromThis {};
template <class T, ESPMode M = ESPMode::ThreadSafe, class... A> TSharedPtr<T, M> MakeShared(A &&...arguments) {
    (void)sizeof(T(std::forward<A>(arguments)...));
    return {};
}
template <class T> class TObjectPtr {
public:
    TObjectPtr();
    TObjectPtr(T *);
    operator T *() const;
    T &operator*() const;
    T *operator->() const;
};
template <class T> class TWeakObjectPtr {
public:
    TWeakObjectPtr();
    TWeakObjectPtr &operator=(T *);
    bool IsValid() const;
    T *Get() const;
    T *operator->() const;
};
template <class T> class TSubclassOf {
public:
    TSubclassOf(class UClass *);
};

template <class T> struct TVector {
    T X, Y, Z;
    TVector();
    TVector(T, T, T);
    template <class U> explicit TVector(const TVector<U> &);
    TVector &operator+=(const TVector &);
    TVector operator+(const TVector &) const;
    TVector operator-(const TVector &) const;
    TVector operator*(T) const;
    static const TVector ZeroVector;
};
using FVector = TVector<double>;
using FVector3f = TVector<float>;
struct FQuat {
    double X, Y, Z, W;
    FQuat(double, double, double, double);
    static FQuat Slerp(const FQuat &, const FQuat &, double);
};
struct FRotator {
    double Pitch, Yaw, Roll;
    FVector UnrotateVector(const FVector &) const;
};
struct FTransform {
    FTransform(const FQuat &, const FVector &);
    FQuat GetRotation() const;
    FVector GetTranslation() const;
    void SetRotation(const FQuat &);
    void SetTranslation(const FVector &);
};
struct FLinearColor {
    FLinearColor(float, float, float);
};
struct FGuid {};
struct FMath {
    template <class T> static T Clamp(T, T, T);
    template <class T> static T Max(T, T);
    template <class T> static T Min(T, T);
    template <class T> static T DegreesToRadians(const T &);
    template <class T, class U> static T Lerp(const T &, const T &, const U &);
};
struct FMemory {
    static void *Memcpy(void *, const void *, SIZE_T);
    static void Memzero(void *, SIZE_T);
};
class FCriticalSection {};
class FScopeLock {
public:
    explicit FScopeLock(FCriticalSection *);
    ~FScopeLock();
};
class FScopeTryLock {
public:
    explicit FScopeTryLock(FCriticalSection *);
    ~FScopeTryLock();
    bool IsLocked() const;
};
struct FPlatformTime {
    static double Seconds();
};
struct FPlatformProcess {
    static void *GetDllHandle(const TCHAR *);
    static void FreeDllHandle(void *);
    static const TCHAR *ComputerName();
};
struct FFileHelper {
    static bool LoadFileToArray(TArray<uint8> &, const TCHAR *, uint32 = 0);
};
struct FPaths {
    template <class... A> static FString Combine(A &&...);
    static bool IsRelative(const FString &);
    static FString ProjectContentDir();
    static FString ConvertRelativePathToFull(const FString &);
};

#define DECLARE_LOG_CATEGORY_EXTERN(name, level, compiled) extern struct FStubCategory_##name {} name
#define DEFINE_LOG_CATEGORY(name) FStubCategory_##name name
#define UE_LOG(category, level, ...) ((void)category, (void)FString::Printf(__VA_ARGS__))

class IModuleInterface {
public:
    virtual ~IModuleInterface();
    virtual void StartupModule();
    virtual void ShutdownModule();
};
class FDefaultModuleImpl : public IModuleInterface {};
struct FModuleManager {
    template <class T> static T &GetModuleChecked(FName);
};
#define IMPLEMENT_MODULE(type, name)                                                                                   \
    IModuleInterface *StubStart_##name();                                                                              \
    IModuleInterface *StubStart_##name() { return new type; }

class IPlugin {
public:
    FString GetBaseDir() const;
};
class IPluginManager {
public:
    static IPluginManager &Get();
    TSharedPtr<IPlugin> FindPlugin(const FString &);
};
class IModularFeature {};
class IModularFeatures {
public:
    static IModularFeatures &Get();
    bool IsModularFeatureAvailable(FName);
    template <class T> T &GetModularFeature(FName);
};

// Engine

class UClass;
class UScriptStruct;
class UWorld;
class AActor;
class USoundSubmix {};
struct FObjectInitializer {};
class UObject {
public:
    virtual ~UObject();
    FString GetName() const;
};
struct FFilePath {
    FString FilePath;
};
#define DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(name, type, parameter)                                             \
    struct name {                                                                                                      \
        void Broadcast(type parameter) const;                                                                          \
    }

class ISubmixBufferListener : public TSharedFromThis<ISubmixBufferListener, ESPMode::ThreadSafe> {
public:
    virtual ~ISubmixBufferListener() = default;
    virtual void OnNewSubmixBuffer(const USoundSubmix *, float *, int32, int32, const int32, double) = 0;
    virtual bool IsRenderingAudio() const;
    virtual const FString &GetListenerName() const;
};
class FAudioDevice {
public:
    float GetSampleRate() const;
    void RegisterSubmixBufferListener(TSharedRef<ISubmixBufferListener, ESPMode::ThreadSafe>, USoundSubmix &);
    void UnregisterSubmixBufferListener(TSharedRef<ISubmixBufferListener, ESPMode::ThreadSafe>, USoundSubmix &);
};
class FAudioDeviceHandle {
public:
    bool IsValid() const;
    FAudioDevice *operator->() const;
};
class UWorld : public UObject {
public:
    FAudioDeviceHandle GetAudioDevice() const;
};

class FSubsystemCollectionBase;
class UEngineSubsystem : public UObject {
public:
    virtual void Initialize(FSubsystemCollectionBase &);
    virtual void Deinitialize();
};
class UEngine : public UObject {
public:
    template <class T> T *GetEngineSubsystem() const;
};
extern UEngine *GEngine;

enum ELevelTick { LEVELTICK_All };
enum ETickingGroup { TG_PrePhysics };
namespace EEndPlayReason {
enum Type { Destroyed };
}
struct FActorComponentTickFunction {
    bool bCanEverTick;
    ETickingGroup TickGroup;
};
class UActorComponent : public UObject {
public:
    virtual void BeginPlay();
    virtual void EndPlay(const EEndPlayReason::Type);
    virtual void TickComponent(float, ELevelTick, FActorComponentTickFunction *);
    virtual void AddTickPrerequisiteComponent(UActorComponent *);
    AActor *GetOwner() const;
    UWorld *GetWorld() const;
    FActorComponentTickFunction PrimaryComponentTick;
    bool bAutoActivate;
};
class USceneComponent : public UActorComponent {
public:
    FVector GetComponentLocation() const;
    virtual bool DoesSocketExist(FName) const;
    virtual FVector GetSocketLocation(FName) const;
};
struct FPositionVertexBuffer {
    const void *GetVertexData() const;
    uint32 GetNumVertices() const;
    const FVector3f &VertexPosition(uint32) const;
};
struct FSkinWeightDataVertexBuffer {
    const uint8 *GetWeightData() const;
};
struct FSkinWeightVertexBuffer {
    const FSkinWeightDataVertexBuffer *GetDataVertexBuffer() const;
    uint32 GetBoneIndex(uint32, uint32) const;
    uint16 GetBoneWeight(uint32, uint32) const;
};
struct FSkelMeshRenderSection {
    uint32 BaseVertexIndex, NumVertices;
    TArray<uint16> BoneMap;
};
struct FSkeletalMeshLODRenderData {
    struct {
        FPositionVertexBuffer PositionVertexBuffer;
    } StaticVertexBuffers;
    struct {
        void GetIndexBuffer(TArray<uint32> &) const;
    } MultiSizeIndexContainer;
    TArray<FSkelMeshRenderSection> RenderSections;
    const FSkinWeightVertexBuffer *GetSkinWeightVertexBuffer() const;
};
struct FSkeletalMeshRenderData {
    TArray<FSkeletalMeshLODRenderData> LODRenderData;
};
class USkeletalMesh : public UObject {
public:
    FSkeletalMeshRenderData *GetResourceForRendering() const;
};
class USkeletalMeshComponent : public USceneComponent {
public:
    USkeletalMesh *GetSkeletalMeshAsset() const;
};
class AActor : public UObject {
public:
    template <class T> T *FindComponentByClass() const;
    FVector GetActorLocation() const;
    FRotator GetActorRotation() const;
    virtual void GetActorEyesViewPoint(FVector &, FRotator &) const;
};
template <class T> class TInlineComponentArray {
public:
    explicit TInlineComponentArray(const AActor *);
    T *begin();
    T *end();
};
class USynthComponent : public UActorComponent {
public:
    explicit USynthComponent(const FObjectInitializer &);
    void Start();
    void Stop();

protected:
    virtual bool Init(int32 &);
    virtual int32 OnGenerateAudio(float *, int32);
    int32 NumChannels;
};

// Animation

class UAnimInstance : public UObject {
public:
    AActor *GetOwningActor() const;
    USkeletalMeshComponent *GetSkelMeshComponent() const;
};
struct FAnimationInitializeContext {};
struct FAnimationCacheBonesContext {};
struct FAnimationUpdateContext {
    float GetDeltaTime() const;
};
struct FMeshPoseBoneIndex {
    explicit FMeshPoseBoneIndex(int32);
};
struct FCompactPoseBoneIndex {
    bool IsValid() const;
};
struct FReferenceSkeleton {
    int32 GetNum() const;
    FName GetBoneName(int32) const;
    int32 GetParentIndex(int32) const;
    const TArray<FTransform> &GetRefBonePose() const;
};
struct FBoneContainer {
    const FReferenceSkeleton &GetReferenceSkeleton() const;
    FCompactPoseBoneIndex MakeCompactPoseIndex(const FMeshPoseBoneIndex &) const;
};
struct FCompactPose {
    const FBoneContainer &GetBoneContainer() const;
    FTransform &operator[](const FCompactPoseBoneIndex &);
};
struct FBlendedCurve {
    float Get(FName) const;
    void Set(FName, float);
};
struct FPoseContext {
    FCompactPose Pose;
    FBlendedCurve Curve;
};
struct FNodeDebugData {
    void AddDebugItem(FString);
    template <class T> FString GetNodeName(T *);
};
struct FPoseLink {
    void Initialize(const FAnimationInitializeContext &);
    void CacheBones(const FAnimationCacheBonesContext &);
    void Update(const FAnimationUpdateContext &);
    void Evaluate(FPoseContext &);
    void GatherDebugData(FNodeDebugData &);
};
struct FExposedValueHandler {
    void Execute(const FAnimationUpdateContext &) const;
};
struct FAnimNode_Base {
    virtual ~FAnimNode_Base();
    virtual void Initialize_AnyThread(const FAnimationInitializeContext &);
    virtual void CacheBones_AnyThread(const FAnimationCacheBonesContext &);
    virtual void Update_AnyThread(const FAnimationUpdateContext &);
    virtual void Evaluate_AnyThread(FPoseContext &);
    virtual void GatherDebugData(FNodeDebugData &);
    virtual bool HasPreUpdate() const;
    virtual void PreUpdate(const UAnimInstance *);
    const FExposedValueHandler &GetEvaluateGraphExposedInputs() const;
};
namespace ENodeTitleType {
enum Type { FullTitle };
}
class UAnimGraphNode_Base : public UObject {
public:
    virtual FText GetNodeTitle(ENodeTitleType::Type) const;
    virtual FText GetTooltipText() const;
    virtual FLinearColor GetNodeTitleColor() const;
    virtual FText GetMenuCategory() const;
};

// Live Link

class ILiveLinkClient;
class ILiveLinkSource {
public:
    virtual ~ILiveLinkSource();
    virtual void ReceiveClient(ILiveLinkClient *, FGuid) = 0;
    virtual bool IsSourceStillValid() const = 0;
    virtual bool RequestSourceShutdown() = 0;
    virtual FText GetSourceType() const = 0;
    virtual FText GetSourceMachineName() const = 0;
    virtual FText GetSourceStatus() const = 0;
};
struct FLiveLinkSubjectKey {
    FLiveLinkSubjectKey(FGuid, FName);
};
struct FLiveLinkWorldTime {
    FLiveLinkWorldTime(const double);
};
struct FLiveLinkBaseStaticData {
    TArray<FName> PropertyNames;
};
struct FLiveLinkSkeletonStaticData : FLiveLinkBaseStaticData {
    static UScriptStruct *StaticStruct();
    TArray<FName> BoneNames;
    TArray<int32> BoneParents;
};
struct FLiveLinkBaseFrameData {
    FLiveLinkWorldTime WorldTime;
    TArray<float> PropertyValues;
};
struct FLiveLinkAnimationFrameData : FLiveLinkBaseFrameData {
    static UScriptStruct *StaticStruct();
    TArray<FTransform> Transforms;
};
template <class Base> struct TStubLiveLinkStruct {
    explicit TStubLiveLinkStruct(const UScriptStruct *);
    TStubLiveLinkStruct(TStubLiveLinkStruct &&);
    TStubLiveLinkStruct(const TStubLiveLinkStruct &) = delete;
    template <class T> T *Cast() {
        static_assert(std::is_base_of_v<Base, T>);
        return nullptr;
    }
};
using FLiveLinkStaticDataStruct = TStubLiveLinkStruct<FLiveLinkBaseStaticData>;
using FLiveLinkFrameDataStruct = TStubLiveLinkStruct<FLiveLinkBaseFrameData>;
class ULiveLinkRole : public UObject {};
class ULiveLinkAnimationRole : public ULiveLinkRole {
public:
    static UClass *StaticClass();
};
class ILiveLinkClient : public IModularFeature {
public:
    static FName ModularFeatureName;
    virtual ~ILiveLinkClient();
    virtual FGuid AddSource(TSharedPtr<ILiveLinkSource>) = 0;
    virtual void RemoveSource(TSharedPtr<ILiveLinkSource>) = 0;
    virtual void PushSubjectStaticData_AnyThread(const FLiveLinkSubjectKey &, TSubclassOf<ULiveLinkRole>,
                                                 FLiveLinkStaticDataStruct &&) = 0;
    virtual void PushSubjectFrameData_AnyThread(const FLiveLinkSubjectKey &, FLiveLinkFrameDataStruct &&) = 0;
};
