// SPDX-License-Identifier: MIT OR Apache-2.0
// The subset of NUnit that the package's tests use, and a program that runs them.

using System;
using System.Linq;
using System.Reflection;

namespace NUnit.Framework
{
    [AttributeUsage(AttributeTargets.Method)] public sealed class TestAttribute : Attribute { }

    public static class Assert
    {
        public static void AreEqual(object expected, object actual, string message = "")
        {
            if (!Equals(expected, actual)) throw new Exception(message + ": wanted " + expected + ", got " + actual);
        }
        public static void AreEqual(double expected, double actual, double delta, string message = "")
        {
            if (!(Math.Abs(expected - actual) <= delta)) throw new Exception(message + ": wanted " + expected + ", got " + actual);
        }
        public static void IsTrue(bool condition, string message = "")
        {
            if (!condition) throw new Exception(message);
        }
    }

    internal static class Runner
    {
        public static string[] Arguments;

        private static int Main(string[] args)
        {
            Arguments = args;
            int run = 0, failed = 0;
            foreach (MethodInfo test in typeof(Runner).Assembly.GetTypes().SelectMany(type => type.GetMethods()).Where(m => m.IsDefined(typeof(TestAttribute), false)))
            {
                run++;
                try
                {
                    test.Invoke(Activator.CreateInstance(test.DeclaringType), null);
                    Console.WriteLine("ok      " + test.DeclaringType.Name + "." + test.Name);
                }
                catch (TargetInvocationException error)
                {
                    failed++;
                    Console.WriteLine("FAILED  " + test.Name + "\n" + error.InnerException);
                }
            }
            Console.WriteLine("{0} tests, {1} failed", run, failed);
            return run > 0 && failed == 0 ? 0 : 1;
        }
    }
}
