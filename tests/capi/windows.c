/* Windows specifics: file names, sharing of a model's file, pipes, devices, threads, windows. `windows MODEL`,
   linked as a program without a console. */

#define UNICODE
#define _WIN32_WINNT 0x0A00
#include <windows.h>

#include <tlhelp32.h>

#include "check.h"

enum { ROOM = 2048 };

static wchar_t base[ROOM], original[ROOM];

/* Converts a path to UTF-8 for the library. */
static const char *utf8(const wchar_t *path) {
    static char text[4 * ROOM];
    CHECK(WideCharToMultiByte(CP_UTF8, WC_ERR_INVALID_CHARS, path, -1, text, sizeof text, NULL, NULL) > 0);
    return text;
}

static const wchar_t *inside(const wchar_t *folder, const wchar_t *name) {
    static wchar_t paths[4][ROOM];
    static unsigned next;
    wchar_t *path = paths[next++ % 4];
    CHECK(wcslen(folder) + wcslen(name) + 2 <= ROOM);
    wcscpy(path, folder);
    wcscat(path, L"\\");
    wcscat(path, name);
    return path;
}

static void loads(const wchar_t *path) {
    OK(umo_model_free(load_model(utf8(path))));
}

/* Checks that loading a path fails for the given reason. */
static void is_refused(const wchar_t *path, const char *reason) {
    umo_model *none = NULL;
    FAILS(IO, umo_model_load(UMO_ABI_VERSION, utf8(path), NULL, &none));
    CHECK(none == NULL && strstr(umo_last_error(), reason));
}

static void paths_are_in_any_language(void) {
    const wchar_t *path = inside(base, L"Gr\u00f6\u00dfe \u65e5\u672c \U0001F600.safetensors");
    CHECK(CopyFile(original, path, TRUE));
    loads(path);
    CHECK(DeleteFile(path));
}

/* Longer than old Windows functions accept, by the plain name and by the \\?\ name without a limit. */
static void paths_are_long(void) {
    static const wchar_t name[] = L"a folder whose name has forty characters";
    wchar_t folders[8][ROOM];
    for (int i = 0; i < 8; i++) {
        wcscpy(folders[i], inside(i == 0 ? inside(L"\\\\?", base) : folders[i - 1], name));
        CHECK(CreateDirectory(folders[i], NULL));
    }
    const wchar_t *path = inside(folders[7], L"model.safetensors");
    CHECK(wcslen(path) > MAX_PATH + 4);
    CHECK(CopyFile(original, path, TRUE));
    loads(path);
    loads(path + 4);
    CHECK(DeleteFile(path));
    for (int i = 7; i >= 0; i--) CHECK(RemoveDirectory(folders[i]));
}

static HANDLE writer(const wchar_t *path) {
    DWORD others = FILE_SHARE_READ | FILE_SHARE_WRITE | FILE_SHARE_DELETE;
    return CreateFile(path, GENERIC_READ | GENERIC_WRITE, others, NULL, OPEN_EXISTING, 0, NULL);
}

/* Half a second of speech and its frames. */
static void run(umo_engine *engine, char *frames, size_t size) {
    static float speech[8000];
    umo_session *avatar = NULL;
    umo_model *model = NULL;
    umo_frame_layout layout;
    size_t count = 0;
    speak(speech, 8000, 0);
    model = load_model(utf8(original));
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    OK(umo_model_free(model));
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_push_audio(avatar, speech, 8000, NULL));
    OK(umo_session_finish(avatar));
    compute(engine);
    memset(frames, 0, size);
    OK(umo_session_pull_frames(avatar, &layout, frames, size, &count));
    CHECK(count == 15);
    OK(umo_session_free(avatar));
}

/* A file open for writing is not loaded. A loaded model is in memory: its file may be overwritten or deleted. */
static void a_model_needs_its_file_while_it_is_loaded(void) {
    static char before[1 << 16], after[1 << 16];
    wchar_t path[ROOM];
    wcscpy(path, inside(base, L"model.safetensors"));
    CHECK(CopyFile(original, path, TRUE));

    HANDLE file = writer(path);
    CHECK(file != INVALID_HANDLE_VALUE);
    is_refused(path, "model.safetensors");
    CHECK(CloseHandle(file));

    umo_model *model = load_model(utf8(path));
    umo_engine *engine = polled_engine(model);
    run(engine, before, sizeof before);
    DWORD written = 0;
    file = writer(path);
    CHECK(file != INVALID_HANDLE_VALUE && WriteFile(file, after, sizeof after, &written, NULL) && SetEndOfFile(file));
    CHECK(CloseHandle(file) && DeleteFile(path));
    run(engine, after, sizeof after);
    CHECK(memcmp(before, after, sizeof before) == 0);
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
}

static void only_files_are_read(void) {
    static const wchar_t name[] = L"\\\\.\\pipe\\umo-test";
    HANDLE pipe = CreateNamedPipe(name, PIPE_ACCESS_DUPLEX, PIPE_TYPE_BYTE, 1, 0, 0, 0, NULL);
    CHECK(pipe != INVALID_HANDLE_VALUE);
    is_refused(name, "a pipe");
    CHECK(CloseHandle(pipe));
    is_refused(L"NUL", "a character device");
    is_refused(base, "a directory");
    is_refused(inside(base, L"missing"), "missing");
}

static BOOL CALLBACK count_window(HWND window, LPARAM count) {
    DWORD process = 0;
    GetWindowThreadProcessId(window, &process);
    if (process == GetCurrentProcessId()) ++*(int *)count;
    return TRUE;
}

/* The library's threads are named and have the process's priority; no window is created. */
static void threads_are_known_by_name(void) {
    typedef HRESULT(WINAPI * describe)(HANDLE, PWSTR *);
    union {
        FARPROC found;
        describe call;
    } description = {GetProcAddress(GetModuleHandle(L"kernelbase"), "GetThreadDescription")};
    CHECK(description.found);
    umo_model *model = load_model(utf8(original));
    umo_engine_config config;
    umo_engine *engine = NULL;
    umo_session *avatar = NULL;
    OK(umo_engine_config_init(&config, sizeof config));
    config.threads = 2;
    OK(umo_engine_new(model, &config, &engine));
    OK(umo_session_new(engine, NULL, &avatar));

    HANDLE all = CreateToolhelp32Snapshot(TH32CS_SNAPTHREAD, 0);
    CHECK(all != INVALID_HANDLE_VALUE);
    THREADENTRY32 entry = {.dwSize = sizeof entry};
    unsigned named = 0;
    for (BOOL more = Thread32First(all, &entry); more; more = Thread32Next(all, &entry)) {
        if (entry.th32OwnerProcessID != GetCurrentProcessId()) continue;
        HANDLE thread = OpenThread(THREAD_QUERY_LIMITED_INFORMATION, FALSE, entry.th32ThreadID);
        PWSTR text = NULL;
        CHECK(thread && SUCCEEDED(description.call(thread, &text)));
        for (unsigned i = 0; i < 2; i++) {
            const wchar_t name[] = {L'u', L'm', L'o', L'-', (wchar_t)(L'0' + i), 0};
            if (wcscmp(text, name) == 0) named |= 1u << i;
        }
        CHECK(GetThreadPriority(thread) == THREAD_PRIORITY_NORMAL);
        LocalFree(text);
        CloseHandle(thread);
    }
    CloseHandle(all);
    CHECK(named == 3);

    int windows = 0;
    EnumWindows(count_window, (LPARAM)&windows);
    CHECK(windows == 0 && GetConsoleWindow() == NULL);
    OK(umo_session_free(avatar));
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    CHECK(MultiByteToWideChar(CP_UTF8, 0, argv[1], -1, original, ROOM) > 0);
    wchar_t temporary[MAX_PATH + 1], folder[32];
    CHECK(GetTempPath(MAX_PATH + 1, temporary) > 0);
    temporary[wcslen(temporary) - 1] = 0;
    swprintf(folder, 32, L"umo-%lu", (unsigned long)GetCurrentProcessId());
    wcscpy(base, inside(temporary, folder));
    CHECK(CreateDirectory(base, NULL));
    paths_are_in_any_language();
    paths_are_long();
    a_model_needs_its_file_while_it_is_loaded();
    only_files_are_read();
    threads_are_known_by_name();
    CHECK(RemoveDirectory(base));
    return 0;
}
