// palpate in C#: palpate.h by P/Invoke, and a class over it. Plain .NET: it needs nothing of Unity, and runs under mono.
// Units are SI. A pose is 7 numbers: position x y z, rotation as a unit quaternion w x y z; right-handed, z up. Coordinates
// says how that lies in Unity. One thread at a time steps a world. Nothing calls back into managed code.

using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Palpate
{
    /// <summary>What palpate could not do: what was wrong, where, and how to mend it.</summary>
    public class PalpateException : Exception
    {
        /// <summary>Of palpate.h.</summary>
        public readonly int Code;
        public PalpateException(int code, string message) : base(message) { Code = code; }
    }

    /// <summary>Fields that World.View shows: as PALPATE_POSITIONS and on in palpate.h.</summary>
    public enum Field
    {
        Positions, Forces, Touches, Pressures, Areas, Faces, SampleNodes, Nodes, RestNodes, Tetrahedra, Stretches,
        Configuration, JointsWanted, JointsSent, JointsReached, BonePoses, TrackedPoses, NetForces, NetTorques, Centres,
        ContactAreas, ObjectPoses, ObjectMotions
    }

    /// <summary>Between palpate (right-handed, z up) and Unity (left-handed, y up): y and z change places.</summary>
    public static class Coordinates
    {
        /// <summary>A position, force or velocity.</summary>
        public static void ToUnity(double x, double y, double z, out float ux, out float uy, out float uz)
        {
            ux = (float)x;
            uy = (float)z;
            uz = (float)y;
        }

        public static void FromUnity(float ux, float uy, float uz, out double x, out double y, out double z)
        {
            x = ux;
            y = uz;
            z = uy;
        }

        /// <summary>A rotation; Unity's order is x y z w. A mirror turns it round.</summary>
        public static void RotationToUnity(double w, double x, double y, double z, out float ux, out float uy, out float uz, out float uw)
        {
            ux = (float)-x;
            uy = (float)-z;
            uz = (float)-y;
            uw = (float)w;
        }

        public static void RotationFromUnity(float ux, float uy, float uz, float uw, out double w, out double x, out double y, out double z)
        {
            w = uw;
            x = -ux;
            y = -uz;
            z = -uy;
        }

        /// <summary>A pose for World.SetFingerPose from Unity's position and rotation.</summary>
        public static double[] PoseFromUnity(float px, float py, float pz, float qx, float qy, float qz, float qw)
        {
            double[] pose = new double[7];
            FromUnity(px, py, pz, out pose[0], out pose[1], out pose[2]);
            RotationFromUnity(qx, qy, qz, qw, out pose[3], out pose[4], out pose[5], out pose[6]);
            return pose;
        }
    }

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

        [DllImport(Library)] internal static extern IntPtr palpate_last_error();
        [DllImport(Library)] internal static extern int palpate_load(byte[] file, IntPtr definition, out long world);
        [DllImport(Library)] internal static extern int palpate_load_text(byte[] text, IntPtr definition, out long world);
        [DllImport(Library)] internal static extern int palpate_load_replay(byte[] file, int run, IntPtr definition, out long world);
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

        internal static byte[] Text(string text) { return Encoding.UTF8.GetBytes(text + "\0"); }

        internal static void Check(int code)
        {
            if (code == 0) return;
            IntPtr message = palpate_last_error();
            int length = 0;
            while (Marshal.ReadByte(message, length) != 0) ++length;
            byte[] bytes = new byte[length];
            Marshal.Copy(message, bytes, 0, length);
            throw new PalpateException(code, Encoding.UTF8.GetString(bytes));
        }
    }

    /// <summary>A scene that is being run.</summary>
    public sealed class World : IDisposable
    {
        long id;

        World(long id) { this.id = id; }
        ~World() { Dispose(); }

        /// <summary>From a scene file, or the name of a scene that comes with palpate.</summary>
        public static World Load(string file)
        {
            long id;
            Native.Check(Native.palpate_load(Native.Text(file), IntPtr.Zero, out id));
            return new World(id);
        }

        /// <summary>From the text of a scene (TOML).</summary>
        public static World LoadText(string text)
        {
            long id;
            Native.Check(Native.palpate_load_text(Native.Text(text), IntPtr.Zero, out id));
            return new World(id);
        }

        /// <summary>Goes through a recorded run (1, 2, ...) again.</summary>
        public static World Replay(string file, int run)
        {
            long id;
            Native.Check(Native.palpate_load_replay(Native.Text(file), run, IntPtr.Zero, out id));
            return new World(id);
        }

        /// <summary>Another world in the same state.</summary>
        public World Clone()
        {
            long clone;
            Native.Check(Native.palpate_clone(id, out clone));
            return new World(clone);
        }

        public void Dispose()
        {
            if (id != 0) Native.palpate_destroy(id);
            id = 0;
            GC.SuppressFinalize(this);
        }

        public WorldInfo Info
        {
            get
            {
                WorldInfo info = new WorldInfo();
                info.Size = Marshal.SizeOf(typeof(WorldInfo));
                Native.Check(Native.palpate_get_info(id, ref info));
                return info;
            }
        }

        public int FindFinger(string name)
        {
            int finger;
            Native.Check(Native.palpate_find_finger(id, Native.Text(name), out finger));
            return finger;
        }

        public int FindObject(string name)
        {
            int found;
            Native.Check(Native.palpate_find_object(id, Native.Text(name), out found));
            return found;
        }

        /// <summary>Changes a setting while it runs: "finger.index.material.young_kPa=40".</summary>
        public void Set(string setting)
        {
            GCHandle text = GCHandle.Alloc(Native.Text(setting), GCHandleType.Pinned);
            try { Native.Check(Native.palpate_set(id, new IntPtr[] { text.AddrOfPinnedObject() }, 1)); }
            finally { text.Free(); }
        }

        /// <summary>Tracked pose of a finger from the next step on; null: its tracker does not see it.</summary>
        public void SetFingerPose(int finger, double[] pose)
        {
            CheckPose(pose, true);
            Native.Check(Native.palpate_set_finger_pose(id, finger, pose));
        }

        public void ReleaseFinger(int finger) { Native.Check(Native.palpate_release_finger(id, finger)); }

        public void SetObjectPose(int index, double[] pose)
        {
            CheckPose(pose, false);
            Native.Check(Native.palpate_set_object_pose(id, index, pose));
        }

        public void ReleaseObject(int index) { Native.Check(Native.palpate_release_object(id, index)); }

        static void CheckPose(double[] pose, bool mayBeNull)
        {
            if (pose == null ? !mayBeNull : pose.Length != 7)
                throw new ArgumentException("a pose is 7 numbers: position x y z [m], rotation w x y z");
        }

        public void Step(int n) { Native.Check(Native.palpate_step(id, n)); }

        /// <summary>Until the simulated time [s] is reached to half a step: in Unity from FixedUpdate, with
        /// Time.fixedTimeAsDouble.</summary>
        public void StepTo(double time) { Native.Check(Native.palpate_step_to(id, time)); }

        Native.View Shown(Field field, int index)
        {
            Native.View view = new Native.View();
            view.Size = Marshal.SizeOf(typeof(Native.View));
            Native.Check(Native.palpate_view(id, (int)field, index, ref view));
            return view;
        }

        /// <summary>Numbers of a field row by row, into an array that is made anew only where it has another size.</summary>
        public void Read(Field field, int index, ref double[] numbers)
        {
            Native.View view = Shown(field, index);
            if (view.Type != 0) throw new ArgumentException(field + " has whole numbers");
            int size = view.Rows * (view.Rank == 2 ? view.Columns : 1);
            if (numbers == null || numbers.Length != size) numbers = new double[size];
            if (size > 0) Marshal.Copy(view.Data, numbers, 0, size);
        }

        public void Read(Field field, int index, ref int[] numbers)
        {
            Native.View view = Shown(field, index);
            if (view.Type != 1) throw new ArgumentException(field + " has no integers");
            int size = view.Rows * (view.Rank == 2 ? view.Columns : 1);
            if (numbers == null || numbers.Length != size) numbers = new int[size];
            if (size > 0) Marshal.Copy(view.Data, numbers, 0, size);
        }

        public void Read(Field field, int index, ref byte[] numbers)
        {
            Native.View view = Shown(field, index);
            if (view.Type != 2) throw new ArgumentException(field + " has no bytes");
            if (numbers == null || numbers.Length != view.Rows) numbers = new byte[view.Rows];
            if (view.Rows > 0) Marshal.Copy(view.Data, numbers, 0, view.Rows);
        }

        public FingerState Finger(int finger)
        {
            FingerState state = new FingerState();
            state.Size = Marshal.SizeOf(typeof(FingerState));
            Native.Check(Native.palpate_get_finger(id, finger, ref state));
            return state;
        }

        public ObjectState Object(int index)
        {
            ObjectState state = new ObjectState();
            state.Size = Marshal.SizeOf(typeof(ObjectState));
            Native.Check(Native.palpate_get_object(id, index, ref state));
            return state;
        }

        public ThimbleState Thimble(int thimble)
        {
            ThimbleState state = new ThimbleState();
            state.Size = Marshal.SizeOf(typeof(ThimbleState));
            Native.Check(Native.palpate_get_thimble(id, thimble, ref state));
            return state;
        }

        /// <summary>The whole state: a branch point.</summary>
        public byte[] Save()
        {
            long needed;
            Native.Check(Native.palpate_save(id, null, 0, out needed));
            byte[] state = new byte[needed];
            Native.Check(Native.palpate_save(id, state, needed, out needed));
            return state;
        }

        public void Restore(byte[] state) { Native.Check(Native.palpate_restore(id, state, state.LongLength)); }

        public ReplayState Replayed
        {
            get
            {
                ReplayState state = new ReplayState();
                state.Size = Marshal.SizeOf(typeof(ReplayState));
                Native.Check(Native.palpate_get_replay(id, ref state));
                return state;
            }
        }
    }
}
