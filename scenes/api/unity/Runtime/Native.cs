// palpate.h by P/Invoke: its structs and functions. World (Palpate.cs) is what programs use. There is no log hook: nothing
// calls back into managed code; World.Text(Told.Warnings) has what it would be told.

using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;
using System.Text;

namespace Palpate
{
    [StructLayout(LayoutKind.Sequential)]
    public struct WorldInfo
    {
        public int Size, FingerCount, ObjectCount, ThimbleCount;
        public double Time, Dt, Duration;
        public long Step, Generation;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct FingerState
    {
        public int Size, Touching;
        public double Time;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 7)] public double[] TrackedPose;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 7)] public double[] BonePose;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Force;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Torque;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Centre;
        public double NormalForce, ContactArea, CouplingForce, Silent, Residual;
        public int Converged, Iterations;
        public long Resets;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct ObjectState
    {
        public int Size, Moves;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 7)] public double[] Pose;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Velocity;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Spin;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Force;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Torque;
        public double ContactArea;
        public int Soft, Touching;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct ThimbleState
    {
        public int Size, Finger, ConfigurationCount, JointCount;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 6)] public double[] Configuration;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 6)] public double[] Wanted;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 6)] public double[] Sent;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 6)] public double[] Reached;
        public double Error;
        public int Matches, AtLimit;
    }

    [StructLayout(LayoutKind.Sequential)]
    public struct ReplayState
    {
        public int Size, Same;
        public long Steps, Done, Different;
    }

    /// <summary>A finger to be made: as PalpateFingerDef.</summary>
    public sealed class FingerOptions
    {
        /// <summary>Null: "finger 0", ...</summary>
        public string Name;
        /// <summary>Preset or finger file (ends with .toml).</summary>
        public string Finger = "index-median";
        /// <summary>Kind of the thimble that it wears, and method of its matching; null: none, "constrained".</summary>
        public string Device, Method;
        /// <summary>Tetrahedra wanted; 0: as the preset has it.</summary>
        public int Elements;
        /// <summary>Tracked pose until another one is set: position x y z [m], rotation w x y z.</summary>
        public double[] Pose = { 0, 0, 0, 1, 0, 0, 0 };
        /// <summary>[Pa]; 0: as the preset has it.</summary>
        public double YoungModulus;
    }

    public enum Shape { Plane, Box, Sphere, Capsule, Cylinder, Mesh }

    /// <summary>An object to be made: as PalpateObjectDef.</summary>
    public sealed class ObjectOptions
    {
        public Shape Shape;
        /// <summary>Null: "object 0", ...</summary>
        public string Name;
        /// <summary>Of a mesh, in mm.</summary>
        public string File;
        /// <summary>Box: edges x y z; others: radius, length [m].</summary>
        public double[] Dimensions = { 0, 0, 0 };
        public double[] Pose = { 0, 0, 0, 1, 0, 0, 0 };
        /// <summary>Coulomb coefficient; pressure on skin per depth [Pa/m], 0: rigid; mass [kg], 0: forces do not move it.</summary>
        public double Friction, Stiffness, Mass;
        /// <summary>Of tissue: Young's modulus [Pa], 0: rigid; Poisson's ratio, 0: as palpate has it.</summary>
        public double YoungModulus, Poisson;
        /// <summary>Side of the tissue that is held.</summary>
        public string Fixed = "bottom";
        /// <summary>What lies that near to this side is held, too [m].</summary>
        public double FixedDepth;
        /// <summary>Tetrahedra wanted of the tissue; 0: as palpate has it.</summary>
        public int Elements;
    }

    /// <summary>What World.List lists, as PALPATE_FINGERS and on.</summary>
    public enum Part { Fingers, Objects, Thimbles }

    /// <summary>What World.Text tells, as PALPATE_TEXT_SCENE and on.</summary>
    public enum Told { Scene, Warnings, Settings, Folder, Finger, Object, Thimble, File, Report }

    /// <summary>Texts and lists that stay in their places while palpate reads them.</summary>
    internal sealed class Pins : IDisposable
    {
        readonly List<GCHandle> handles = new List<GCHandle>();

        internal IntPtr Of(object array)
        {
            if (array == null) return IntPtr.Zero;
            GCHandle handle = GCHandle.Alloc(array, GCHandleType.Pinned);
            handles.Add(handle);
            return handle.AddrOfPinnedObject();
        }

        internal IntPtr Text(string text) { return text == null ? IntPtr.Zero : Of(Native.Text(text)); }

        internal IntPtr[] Texts(string[] texts)
        {
            IntPtr[] all = new IntPtr[texts == null ? 0 : texts.Length];
            for (int i = 0; i < all.Length; ++i) all[i] = Text(texts[i]);
            return all;
        }

        public void Dispose()
        {
            foreach (GCHandle handle in handles) handle.Free();
            handles.Clear();
        }
    }

    internal static class Native
    {
        const string Library = "palpate";

        [StructLayout(LayoutKind.Sequential)]
        internal struct View
        {
            public int Size, Type, Rank, Rows, Columns, Reserved;
            public long Generation;
            public IntPtr Data;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct WorldDef
        {
            public int Size, Threads;
            public IntPtr Settings;
            public int SettingCount, Reserved;
            public IntPtr Folder;
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct FingerDef
        {
            public int Size, Elements;
            public IntPtr Name, Finger, Device, Method;
            [MarshalAs(UnmanagedType.ByValArray, SizeConst = 7)] public double[] Pose;
            public double YoungModulus;

            internal FingerDef(FingerOptions from, Pins pins)
            {
                World.CheckPose(from.Pose, false);
                Size = Marshal.SizeOf(typeof(FingerDef));
                Elements = from.Elements;
                Name = pins.Text(from.Name);
                Finger = pins.Text(from.Finger);
                Device = pins.Text(from.Device);
                Method = pins.Text(from.Method);
                Pose = from.Pose;
                YoungModulus = from.YoungModulus;
            }
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct ObjectDef
        {
            public int Size, Shape;
            public IntPtr Name, File;
            [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Dimensions;
            [MarshalAs(UnmanagedType.ByValArray, SizeConst = 7)] public double[] Pose;
            public double Friction, Stiffness, Mass, YoungModulus, Poisson;
            public IntPtr Fixed;
            public double FixedDepth;
            public int Elements, Reserved;

            internal ObjectDef(ObjectOptions from, Pins pins)
            {
                World.CheckPose(from.Pose, false);
                if (from.Dimensions == null || from.Dimensions.Length > 3) throw new ArgumentException("dimensions: expected up to 3 [m]");
                Size = Marshal.SizeOf(typeof(ObjectDef));
                Shape = (int)from.Shape;
                Name = pins.Text(from.Name);
                File = pins.Text(from.File);
                Dimensions = new double[3];
                from.Dimensions.CopyTo(Dimensions, 0);
                Pose = from.Pose;
                Friction = from.Friction;
                Stiffness = from.Stiffness;
                Mass = from.Mass;
                YoungModulus = from.YoungModulus;
                Poisson = from.Poisson;
                Fixed = pins.Text(from.Fixed);
                FixedDepth = from.FixedDepth;
                Elements = from.Elements;
                Reserved = 0;
            }
        }

        [StructLayout(LayoutKind.Sequential)]
        internal struct SceneDef
        {
            public int Size, FingerCount;
            public IntPtr Fingers, Objects;
            public int ObjectCount, Reserved;
            public double Dt;
            [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] Gravity;
            public IntPtr Preset, More;
        }

        [DllImport(Library)] internal static extern int palpate_api_version();
        [DllImport(Library)] internal static extern IntPtr palpate_version();
        [DllImport(Library)] internal static extern IntPtr palpate_last_error();
        [DllImport(Library)] internal static extern int palpate_load(byte[] file, ref WorldDef definition, out long world);
        [DllImport(Library)] internal static extern int palpate_load_text(byte[] text, ref WorldDef definition, out long world);
        [DllImport(Library)] internal static extern int palpate_load_replay(byte[] file, int run, ref WorldDef definition, out long world);
        [DllImport(Library)] internal static extern int palpate_clone(long world, out long clone);
        [DllImport(Library)] internal static extern int palpate_destroy(long world);
        [DllImport(Library)] internal static extern int palpate_get_info(long world, ref WorldInfo info);
        [DllImport(Library)] internal static extern int palpate_find_finger(long world, byte[] name, out int finger);
        [DllImport(Library)] internal static extern int palpate_find_object(long world, byte[] name, out int found);
        [DllImport(Library)] internal static extern int palpate_set(long world, IntPtr[] settings, int count);
        [DllImport(Library)] internal static extern int palpate_set_finger_pose(long world, int finger, double[] pose);
        [DllImport(Library)] internal static extern int palpate_release_finger(long world, int finger);
        [DllImport(Library)] internal static extern int palpate_set_object_pose(long world, int index, double[] pose);
        [DllImport(Library)] internal static extern int palpate_release_object(long world, int index);
        [DllImport(Library)] internal static extern int palpate_step(long world, int n);
        [DllImport(Library)] internal static extern int palpate_step_to(long world, double time);
        [DllImport(Library)] internal static extern int palpate_view(long world, int field, int index, ref View view);
        [DllImport(Library)] internal static extern int palpate_get_finger(long world, int finger, ref FingerState state);
        [DllImport(Library)] internal static extern int palpate_get_object(long world, int index, ref ObjectState state);
        [DllImport(Library)] internal static extern int palpate_get_thimble(long world, int thimble, ref ThimbleState state);
        [DllImport(Library)] internal static extern int palpate_save(long world, byte[] buffer, long capacity, out long needed);
        [DllImport(Library)] internal static extern int palpate_restore(long world, byte[] bytes, long size);
        [DllImport(Library)] internal static extern int palpate_get_replay(long world, ref ReplayState state);

        [DllImport(Library)] internal static extern int palpate_default_world_def(ref WorldDef definition, int size);
        [DllImport(Library)] internal static extern int palpate_default_scene_def(ref SceneDef definition, int size);
        [DllImport(Library)] internal static extern int palpate_build(ref SceneDef scene, ref WorldDef definition, out long world);
        [DllImport(Library)] internal static extern int palpate_get_text(long world, int text, int index, byte[] buffer, long capacity, out long needed);
        [DllImport(Library)] internal static extern int palpate_list(long world, int what, int[] ids, int capacity, out int count);
        [DllImport(Library)] internal static extern int palpate_add_finger(long world, ref FingerDef definition, out int finger);
        [DllImport(Library)] internal static extern int palpate_remove_finger(long world, int finger);
        [DllImport(Library)] internal static extern int palpate_add_object(long world, ref ObjectDef definition, out int added);
        [DllImport(Library)] internal static extern int palpate_remove_object(long world, int removed);
        [DllImport(Library)] internal static extern int palpate_set_thimble(long world, int finger, byte[] kind, byte[] method);
        [DllImport(Library)] internal static extern int palpate_step_many(long[] worlds, int count, int n);
        [DllImport(Library)] internal static extern int palpate_keep_snapshots(long world, int on);
        [DllImport(Library)] internal static extern int palpate_read_snapshot(long world, int finger, ref FingerState state, double[] positions, double[] forces, int capacity, out int samples);
        [DllImport(Library)] internal static extern int palpate_keep_frames(long world, double perSecond);
        [DllImport(Library)] internal static extern int palpate_record(long world, byte[] file);
        [DllImport(Library)] internal static extern int palpate_end_recording(long world);

        internal static byte[] Text(string text) { return text == null ? null : Encoding.UTF8.GetBytes(text + "\0"); }

        internal static void Check(int code)
        {
            if (code == 0) return;
            throw new PalpateException(code, Said(palpate_last_error()));
        }

        internal static string Said(IntPtr text)
        {
            int length = 0;
            while (Marshal.ReadByte(text, length) != 0) ++length;
            byte[] bytes = new byte[length];
            Marshal.Copy(text, bytes, 0, length);
            return Encoding.UTF8.GetString(bytes);
        }
    }
}
