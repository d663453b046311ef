#ifndef UMO_API
#if defined(_WIN32) && !defined(UMO_STATIC)
#define UMO_API __declspec(dllimport)
#else
#define UMO_API
#endif
#endif

#if defined(__cplusplus) && __cplusplus >= 201103L
#define UMO_NOEXCEPT noexcept
#else
#define UMO_NOEXCEPT
#endif

#if defined(__cplusplus) && __cplusplus >= 201703L
#define UMO_MUST_USE [[nodiscard]]
#elif defined(__GNUC__) || defined(__clang__)
#define UMO_MUST_USE __attribute__((warn_unused_result))
#else
#define UMO_MUST_USE
#endif
